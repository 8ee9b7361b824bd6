"""`python -m hilbridge`: the same as `hilbridge`."""

from hilbridge.entry import start


def main() -> None:
    """Entry point."""
    start("hilbridge.cli")


if __name__ == "__main__":
    main()
