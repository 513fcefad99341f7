"""Entry point of the command ``clearcap``, also as ``python -m clearcap``.

The command is imported only after the current folder is off the module path and Ctrl-C is handled.
"""

import atexit
import gc
import os
import sys

ALIVE = 5_000  # objects more than before, at which the garbage collector looks for cycles; Python itself: 700


def main() -> None:
    """Run the command."""
    # The 150,000 objects that a command imports all live until its end, when the operating system frees them at once.
    # To search them for cycles, time after time and again at the end, takes a quarter of a short command.
    gc.set_threshold(ALIVE)
    atexit.register(gc.freeze)
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
