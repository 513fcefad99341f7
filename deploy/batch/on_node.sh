#!/usr/bin/env bash
# on_node.sh dask worker ...: run workers with a folder of yours alone on this node's disk, for scratch files and compiled
# code. Nobody can foresee its name. Your next job on the node finds it again, so that it need not compile for a minute.
set -euo pipefail
local=${TMPDIR:-/tmp}
folder=$(find "$local" -maxdepth 1 -type d -name 'clearcap.*' -user "$(id -u)" -perm 700 -print -quit)
folder=${folder:-$(mktemp -d "$local/clearcap.XXXXXX")}
export NUMBA_CACHE_DIR="$folder/compiled" NUMBA_NUM_THREADS=1
export PYTHONSAFEPATH=1 # no module comes from the folder in which a job stands
exec "$@" --local-directory "$folder"
