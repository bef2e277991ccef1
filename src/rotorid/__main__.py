"""The entry point: what is imported is imported inside, so that Ctrl-C is one line then, too."""

import sys


def main() -> None:
    """Run the command line of this process."""
    try:
        from rotorid.cli import main as run

        run()
    except KeyboardInterrupt:
        print("rotorid: interrupted", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
