"""A service that is killed again and again while clients write: nothing acknowledged may be lost."""
