"""``python -m trackbench``: the command line."""

from trackbench.cli import main

if __name__ == "__main__":
    main()
