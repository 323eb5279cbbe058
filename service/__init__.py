"""The REST service: the method of `core` over HTTP, on stored shapes."""
