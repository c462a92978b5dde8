"""``python -m simple_ros_firmware_bridge``."""

import typer

from simple_ros_firmware_bridge.cli import PROGRAM, bridge


def main() -> None:
    """Run ``simple-ros-pico-bridge``."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(context_settings={"help_option_names": ["-h", "--help"]})(bridge)
    app(prog_name=PROGRAM)


if __name__ == "__main__":
    main()
