"""Commands that evaluate the method on labelled collections, and measure its cost."""
