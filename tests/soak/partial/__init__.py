"""Parts of real models looked for among the whole ones: `make partial-test`."""
