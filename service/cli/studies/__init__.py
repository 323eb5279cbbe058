"""The research commands of `isoshape`, a file a command."""
