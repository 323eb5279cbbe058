"""Who may do what: keys, signed-in browsers, and how often."""
