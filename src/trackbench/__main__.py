"""The command line, for ``python -m trackbench``."""

from trackbench.cli import main

if __name__ == "__main__":
    main()
