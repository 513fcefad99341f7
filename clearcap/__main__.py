"""Entry point of the command ``clearcap``, also as ``python -m clearcap``.

The command is imported only after the current folder is off the module path and Ctrl-C is handled.
"""

from campaign.safe_path import leave_current_folder_out


def main() -> None:
    """Run the command."""
    leave_current_folder_out()
    from campaign.interrupts import exit_at_interrupt

    with exit_at_interrupt():
        from clearcap.cli import main as command

        command()


if __name__ == "__main__":
    main()
