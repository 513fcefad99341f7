"""A coordinator process that a server starts and keeps alive."""

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence

from campaign.environment import STORE
from campaign.safe_path import python_environment
from campaign.store import Store

logger = logging.getLogger(__name__)
FIRST_PAUSE, LONGEST_PAUSE = 1.0, 60.0  # s between the end of a coordinator and the start of the next
SOUND_AFTER = 60.0  # s of run time after which the end of a coordinator no longer counts as a failed start
END_WITHIN = 30.0  # s


class CoordinatorChild:
    """Keep ``clearcap coordinate`` running, which computes every campaign queued in the store, of other users too.

    If another coordinator already serves the store, that one does the work, and this one waits until it ends. The
    coordinator ends with its server, even if the server is killed, so stopping a server stops all its computations.
    """

    def __init__(self, store: Store, options: Sequence[str]) -> None:
        self._words = [sys.executable, "-P", "-m", "clearcap", "coordinate", "--parent", str(os.getpid()), *options]
        # the URL may hold credentials, and other users of the machine can see a command line
        self._environment = {**python_environment(), STORE: store.files.full_url}
        self._over = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._keep_alive, name="coordinator", daemon=True)

    def start(self) -> None:
        """Start the coordinator."""
        self._thread.start()

    @property
    def is_alive(self) -> bool:
        """Whether the coordinator runs now."""
        process = self._process
        return process is not None and process.poll() is None

    def stop(self) -> None:
        """Shut the coordinator down; the rows it has computed are in the store."""
        self._over.set()
        process = self._process
        if process is not None and process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(END_WITHIN)
            except subprocess.TimeoutExpired:
                logger.warning("the coordinator (process %d) did not end within %g s", process.pid, END_WITHIN)
                process.kill()
                process.wait()
        if self._thread.is_alive():
            self._thread.join(END_WITHIN)

    def _keep_alive(self) -> None:
        """Restart the coordinator whenever it has ended; double the pause after each early end."""
        pause = FIRST_PAUSE
        while not self._over.is_set():
            begin = time.monotonic()
            self._process = subprocess.Popen(
                # in a session of its own, because Ctrl-C in a terminal must reach the server only, which then stops it
                self._words,
                stdin=subprocess.DEVNULL,
                cwd=os.sep,
                env=self._environment,
                start_new_session=True,
            )
            if self._over.is_set():  # the server ended while the coordinator started
                self._process.send_signal(signal.SIGTERM)
            status = self._process.wait()
            if self._over.is_set():
                return
            lasted = time.monotonic() - begin
            pause = FIRST_PAUSE if lasted > SOUND_AFTER else min(2.0 * pause, LONGEST_PAUSE)
            logger.warning(
                "the coordinator ended with status %d after %.0f s; starts again in %g s", status, lasted, pause
            )
            self._over.wait(pause)
