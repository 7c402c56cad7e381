"""`python -m space_envs.robots`: commands about robots; `check` measures one."""

import sys

from space_envs.robots.check import command
from space_envs.system.command_line import Parser, exit_status

PROGRAM = "python -m space_envs.robots"


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    if given[:1] == ["check"]:
        return exit_status(f"{PROGRAM} check", lambda: command.run(given[1:]))
    parser = Parser(prog=PROGRAM, description="Commands about robots.")
    parser.add_argument(
        "command", choices=["check"], help="check: measure a robot and say what is implausible"
    )
    parser.parse_args(given[:1])
    return 0


if __name__ == "__main__":
    sys.exit(main())
