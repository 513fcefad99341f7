#!/bin/sh
# Copy the compiled engine from the image to a folder of this container's user alone: Numba reads compiled code only
# where it can write, and clearcap only where nobody else can.
set -eu
umask 077
mkdir -p "$NUMBA_CACHE_DIR"
if [ -z "$(ls -A "$NUMBA_CACHE_DIR")" ]; then
    cp -R --preserve=timestamps /opt/clearcap/compiled/. "$NUMBA_CACHE_DIR"
fi
exec "$@"
