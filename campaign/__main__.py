"""``python -m campaign`` is ``clearcap``; the rest is imported where the current folder and Ctrl-C do no harm."""

from campaign.safe_path import leave_current_folder_out


def main() -> None:
    """Run the command."""
    leave_current_folder_out()
    from campaign.interrupts import exit_at_interrupt

    with exit_at_interrupt():
        from campaign.cli import main as command

        command()


if __name__ == "__main__":
    main()
