"""Entry point of the command `stiction` and of ``python -m stiction``.

Child processes import this module. Therefore all imports that take long are inside the function.
"""

import sys

_COMMANDS_WITH_CHILDREN = {
    "run": False,
    "sweep": True,
    "compare": True,
    "validate": True,
    "check": True,
    "nightly": True,
    "baseline": True,
}
"""Commands that make runs in child processes, and whether the children evaluate them."""


def main() -> None:
    """Run the command line."""
    import stiction.silent_interrupt  # noqa: F401 - sets the handler
    from stiction.child_processes import start_server

    command_name = "".join(sys.argv[1:2])
    if command_name in _COMMANDS_WITH_CHILDREN and "--help" not in sys.argv:
        # The imports of a child take longer than those of the command; they are made meanwhile.
        start_server(with_measures=_COMMANDS_WITH_CHILDREN[command_name])
    from stiction.cli.app import main as command

    command()


if __name__ == "__main__":
    main()
