"""The command `stiction`, as ``python -m stiction`` too; children import this module, so it imports next to nothing."""

import sys


def main() -> None:
    """Run the command line."""
    import stiction.silent_interrupt  # noqa: F401 - sets the handler
    from stiction.child_processes import child_context

    if sys.argv[1:2] == ["run"] and "--help" not in sys.argv:
        child_context()  # the child's imports take longer than all of those here, and are made meanwhile
    from stiction.cli.app import main as command

    command()


if __name__ == "__main__":
    main()
