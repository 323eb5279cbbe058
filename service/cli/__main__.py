"""`python -m service.cli` is `isoshape`."""

from service.cli import main

if __name__ == "__main__":
    main()
