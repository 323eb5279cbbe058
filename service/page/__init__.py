"""The page at /, what it is made of, and the documentation of the interface at /docs."""
