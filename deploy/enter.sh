#!/bin/sh
# Copy the compiled engine from the image to a writable folder: Numba reads a cache only if it can write to it.
set -eu
if [ -z "$(ls -A "$NUMBA_CACHE_DIR")" ]; then
    cp -R --preserve=mode,timestamps /opt/clearcap/compiled/. "$NUMBA_CACHE_DIR"
fi
exec "$@"
