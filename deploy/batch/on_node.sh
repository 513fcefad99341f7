#!/usr/bin/env bash
# on_node.sh dask worker ...: run workers with a private folder on this node's disk, for scratch files and compiled
# code. Its name is unpredictable. Your next job on the node finds it again and saves a minute of compilation.
# dask worker ends when it loses its scheduler, as after half a minute without a network. It is started again as long as
# the scheduler has its file (--scheduler-file) and is not out of reach for ten minutes; if CLEARCAP_LIFETIME is set, for
# as many seconds, so that the workers return their batches before the walltime ends the job.
set -euo pipefail
local=${TMPDIR:-/tmp}
folder=$(find "$local" -maxdepth 1 -type d -name 'clearcap.*' -user "$(id -u)" -perm 700 -print -quit)
folder=${folder:-$(mktemp -d "$local/clearcap.XXXXXX")}
export NUMBA_CACHE_DIR="$folder/compiled" NUMBA_NUM_THREADS=1
export PYTHONSAFEPATH=1 # no module is imported from the working folder of a job

file='' before=''
for word in "$@"; do
    [ "$before" != --scheduler-file ] || file=$word
    before=$word
done

scheduler_is_there() { # wait a minute for one that is being restarted, but not for one whose folder is gone
    for _ in {1..12}; do
        [ ! -e "$file" ] || return 0
        [ -d "$(dirname "$file")" ] || return 1
        sleep 5
    done
    return 1
}

workers='' alone=$SECONDS # since when no worker has been connected
trap 'kill -TERM "$workers" 2>/dev/null || true; wait "$workers" || true; exit 143' TERM
while :; do
    lifetime=()
    if [ -n "${CLEARCAP_LIFETIME:-}" ]; then
        left=$((CLEARCAP_LIFETIME - SECONDS))
        [ "$left" -gt 0 ] || exit 0
        lifetime=(--lifetime "${left}s" --lifetime-stagger "$((left / 50))s")
    fi
    "$@" --local-directory "$folder" "${lifetime[@]}" &
    workers=$! begun=$SECONDS status=0
    wait "$workers" || status=$?
    if [ "$status" = 0 ]; then
        alone=$SECONDS
    elif [ $((SECONDS - begun)) -lt 20 ] || [ $((SECONDS - alone)) -gt 600 ]; then
        exit "$status" # it cannot work, or the scheduler does not come back
    fi
    [ -n "$file" ] && scheduler_is_there || exit "$status"
    echo "on_node.sh: the workers of $(hostname) ended; starting them again"
    sleep 2
done
