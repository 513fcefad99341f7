#!/usr/bin/env bash
# on_node.sh dask worker ...: run workers with a private folder on this node's disk, for scratch files and compiled
# code. Its name is unpredictable. Your next job on the node finds it again and saves a minute of compilation.
set -euo pipefail
local=${TMPDIR:-/tmp}
folder=$(find "$local" -maxdepth 1 -type d -name 'clearcap.*' -user "$(id -u)" -perm 700 -print -quit)
folder=${folder:-$(mktemp -d "$local/clearcap.XXXXXX")}
export NUMBA_CACHE_DIR="$folder/compiled" NUMBA_NUM_THREADS=1
export PYTHONSAFEPATH=1 # no module is imported from the working folder of a job
exec "$@" --local-directory "$folder"
