"""Command line: `python -m signid`."""

from .cli import main

if __name__ == "__main__":
    main()
