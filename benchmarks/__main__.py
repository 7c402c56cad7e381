"""Run the benchmarks whose tables are in docs/, one after the other: python -m benchmarks [NAME ...]."""

import pkgutil
import subprocess
import sys
from importlib import import_module

import benchmarks
from space_envs.errors import unknown_name
from space_envs.system.command_line import Parser, exit_status

NOT_COMMANDS = ("__main__", "arguments", "machine", "same_records", "shooting_program", "simulated")


def names() -> list[str]:
    """Names of all benchmarks."""
    return [m.name for m in pkgutil.iter_modules(benchmarks.__path__) if m.name not in NOT_COMMANDS]


def main(arguments: list[str] | None = None) -> int:
    """Run the benchmarks, each in its own process since some pin cores; returns the exit status."""
    parser = Parser(
        prog="python -m benchmarks",
        description="Run benchmarks and print their tables. Options: python -m benchmarks.NAME --help.",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(names())}; default all")
    parser.add_argument("--list", action="store_true", help="print what each benchmark measures, and stop")
    options = parser.parse_args(arguments)
    for name in options.names:
        if name not in names():
            parser.error(str(unknown_name("benchmark", name, names())))
    chosen = options.names or names()
    if options.list:
        width = max(map(len, chosen)) + 2
        for name in chosen:
            doc = import_module(f"benchmarks.{name}").__doc__ or ""
            print(f"{name:{width}}{' '.join(doc.split(chr(10) * 2)[0].split())}")
        return 0
    status = 0
    for name in chosen:
        print(f"\n## {name}\n", flush=True)
        status = max(status, subprocess.run([sys.executable, "-m", f"benchmarks.{name}"]).returncode)
    return status


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks", main))
