"""``python -m simple_ros_hub``."""

import typer

from simple_ros_hub.cli import PROGRAM, command


def main() -> None:
    """Run ``simple-ros-hub``."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(context_settings={"help_option_names": ["-h", "--help"]})(command)
    app(prog_name=PROGRAM)


if __name__ == "__main__":
    main()
