"""Search: the stored shapes most like one, and two shapes compared."""
