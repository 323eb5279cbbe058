"""What the method costs, measured: one file a subject, each with a function that returns its rows."""
