#!/bin/sh
# Copy the compiled engine from the image to a private folder of this container's user: Numba reads compiled code only
# from folders that it can write, and clearcap only from folders that nobody else can write.
set -eu
umask 077
mkdir -p "$NUMBA_CACHE_DIR"
if [ -z "$(ls -A "$NUMBA_CACHE_DIR")" ]; then
    cp -R --preserve=timestamps /opt/clearcap/compiled/. "$NUMBA_CACHE_DIR"
fi
exec "$@"
