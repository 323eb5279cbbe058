"""Other methods of comparing shapes, by outside libraries, for tables beside this one."""
