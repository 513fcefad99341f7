"""Make Ctrl-C end any command with exit status 130."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130  # exit status
AGAIN_AFTER = 0.05  # s


@contextmanager
def exit_at_interrupt() -> Iterator[None]:
    """End the process cleanly on Ctrl-C in the block, with exit status 130 and no traceback."""
    # Compiled code that calls Python, such as LLVM's, swallows KeyboardInterrupt, because no exception can pass through
    # it; in that case the interrupt is raised again. If Ctrl-C is ignored, as after ``nohup``, it stays ignored.
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    came = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal came
        came = True
        if in_unraisable_hook(frame):
            send_again(number)
            return
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    before, sys.unraisablehook = sys.unraisablehook, _raise_again
    try:
        yield
    except BaseException as ending:
        if not came:
            raise
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process is already ending
        if not isinstance(ending, SystemExit):
            print("clearcap: interrupted", file=sys.stderr)
        exec("0")  # clears Python's mark of an interrupt inside `exec` (dataclasses), which would end `-m` by signal
        sys.exit(INTERRUPTED)
    finally:
        sys.unraisablehook = before
        if not came:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def in_unraisable_hook(frame: FrameType | None) -> bool:
    """Return whether a frame belongs to the hook for swallowed exceptions, where another one would be lost too."""
    hook = getattr(sys.unraisablehook, "__code__", None)
    while frame is not None:
        if frame.f_code is hook:
            return True
        frame = frame.f_back
    return False


def send_again(number: int) -> None:
    """Send a signal to the main thread again shortly after, because its exception was or would be swallowed."""
    again = threading.Timer(AGAIN_AFTER, signal.pthread_kill, [threading.main_thread().ident, number])
    again.daemon = True
    again.start()


def _raise_again(swallowed: "sys.UnraisableHookArgs") -> None:
    """Interrupt the main thread again if an interrupt was swallowed; report other errors as usual."""
    if issubclass(swallowed.exc_type, KeyboardInterrupt):
        send_again(signal.SIGINT)
    else:
        sys.__unraisablehook__(swallowed)
