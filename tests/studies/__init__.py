"""Studies of the method, each a script: `python -m tests.studies.NAME DIR` writes CSV and pictures to DIR."""
