"""The REST service: what the method does, over HTTP, on what is stored."""
