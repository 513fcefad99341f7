"""Entry point of the command ``clearcap``, also as ``python -m clearcap``.

The command is imported only after the current folder is off the module path and Ctrl-C is handled.
"""

import os
import sys


def main() -> None:
    """Run the command."""
    # `campaign` is the one beside this package: a file of that name may lie in the current folder, which comes first
    beside = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    sys.path.insert(0, beside)
    from campaign.safe_path import leave_current_folder_out

    sys.path.remove(beside)
    leave_current_folder_out()
    from campaign.interrupts import exit_at_interrupt

    with exit_at_interrupt():
        from clearcap.cli import main as command

        command()


if __name__ == "__main__":
    main()
