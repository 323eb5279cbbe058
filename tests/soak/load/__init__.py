"""Many clients for many minutes: what is answered, and whether memory grows."""
