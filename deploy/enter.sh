#!/bin/sh
# Lay out what the image has compiled where it can be written to: Numba reads no cache it could not also write.
set -eu
if [ -z "$(ls -A "$NUMBA_CACHE_DIR")" ]; then
    cp -R --preserve=mode,timestamps /opt/clearcap/compiled/. "$NUMBA_CACHE_DIR"
fi
exec "$@"
