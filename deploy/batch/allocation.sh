#!/usr/bin/env bash
# Compute one campaign in one allocation of a batch system (SLURM, OAR, PBS), or on machines that you reach by SSH.
# Scheduler and coordinator run on the first node, workers on all nodes. The job scripts beside this file call it with
# the name of the batch system. Without one call it with `ssh`, on the machine that shall coordinate: workers run on those
# that you name, if they have the same home folders and let you in by a key. It reads these environment variables:
#   CAMPAIGN            a shipped campaign or a campaign file
#   STORE               folder on a file system that all nodes share, or a URL
#   CLEARCAP_TLS        folder of `clearcap certificates`, shared by all nodes; default ~/.clearcap/tls
#   CLEARCAP_HOSTS      machines, for ssh: "node1 node2"
#   CLEARCAP_INTERFACE  network interface between the nodes, such as ib0; default the one of the host name
# When the walltime ends, submit the same job again: it computes the missing rows.
set -euo pipefail
export PYTHONSAFEPATH=1  # no module is imported from the working folder of a job

system=$1
: "${CAMPAIGN:?say which campaign to compute}" "${STORE:?say where the results go}"
tls=${CLEARCAP_TLS:-$HOME/.clearcap/tls}
# a private folder of this job, visible on all nodes
scratch=$(mktemp -d "$HOME/.clearcap-job.XXXXXX")
file=$scratch/scheduler.json

python=$(dirname "$(command -v dask)")/python
network=(--protocol tls)
listening=(--protocol tls)
if [ -n "${CLEARCAP_INTERFACE:-}" ]; then
    network+=(--interface "$CLEARCAP_INTERFACE")
    # not its name: dask scheduler refuses an interface beside a protocol
    address=$("$python" -c '
import sys
from distributed.utils import get_ip_interface
try:
    print(get_ip_interface(sys.argv[1]))
except ValueError as error:
    sys.exit(f"CLEARCAP_INTERFACE: {error}")' "$CLEARCAP_INTERFACE")
    listening=(--host "tls://$address")
fi
closed=(--no-dashboard --dashboard-address 127.0.0.1:0 --preload campaign.cluster.disable_dashboard)

secured() { # secured ROLE: print the options of mutual TLS
    echo "--tls-ca-file=$tls/ca.pem" "--tls-cert=$tls/$1.pem" "--tls-key=$tls/$1.key"
}
read -ra as_scheduler <<<"$(secured scheduler)"
read -ra as_worker <<<"$(secured worker)"

# The last digits of a row depend on these variables; OAR and PBS hand nothing of this environment to the other nodes.
numerical=()
while IFS= read -r name; do
    numerical+=("$name=${!name}")
done < <(compgen -e | grep -E '^((OPENBLAS|OMP|MKL|BLIS|NPY)_|NUMBA_(CPU_|OPT$)|GLIBC_TUNABLES$)' | grep -v '_NUM_THREADS$')

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
worker=(env "PATH=$PATH" "${numerical[@]}" "$here/on_node.sh" dask worker --scheduler-file "$file" "${network[@]}" "${as_worker[@]}"
    "${closed[@]}" --nworkers -1 --nthreads 1 --death-timeout 600 --preload-nanny 'import engine; engine.warm_up()')

pids=()
finish() {
    rm -rf "$scratch"
    kill "${pids[@]}" 2>/dev/null || true
    wait "${pids[@]}" 2>/dev/null || true
}
end_cluster() { # have the workers end before the scheduler: a step that is killed looks like a failure in the log
    "$python" -c '
import json, os, shutil, sys
from distributed import Client, Security
file, ca, cert, key = sys.argv[1:]
security = Security(tls_ca_file=ca, tls_client_cert=cert, tls_client_key=key, require_encryption=True)
client = Client(json.load(open(file))["address"], security=security, timeout=30, set_as_default=False)
shutil.rmtree(os.path.dirname(file))  # so that no node starts its workers again
client.retire_workers(list(client.scheduler_info(n_workers=-1)["workers"]), close_workers=True, remove=False)
client.close()' "$file" "$tls/ca.pem" "$tls/client.pem" "$tls/client.key" >/dev/null 2>&1 || return 0
    for _ in {1..60}; do
        kill -0 "${pids[@]:1}" 2>/dev/null || return 0 # all but the scheduler
        sleep 1
    done
}
trap finish EXIT
trap 'exit 143' TERM

dask scheduler --port 0 "${listening[@]}" "${as_scheduler[@]}" "${closed[@]}" --scheduler-file "$file" &
scheduler=$!
pids+=("$scheduler")

case $system in
    slurm)
        srun --ntasks-per-node=1 --export=ALL "${worker[@]}" &
        pids+=($!)
        ;;
    oar | ssh)
        if [ "$system" = oar ]; then
            launch=(oarsh)
            mapfile -t nodes < <(sort -u "$OAR_NODEFILE")
        else
            launch=(ssh -o BatchMode=yes) # nobody answers a question
            read -ra nodes <<<"${CLEARCAP_HOSTS:?say on which machines}"
        fi
        for node in "${nodes[@]}"; do
            "${launch[@]}" "$node" "$(printf '%q ' "${worker[@]}")" &
            pids+=($!)
        done
        ;;
    pbs)
        mapfile -t nodes < <(sort -u "$PBS_NODEFILE")
        for node in "${nodes[@]}"; do
            pbs_tmrsh "$node" "${worker[@]}" &
            pids+=($!)
        done
        ;;
    *)
        echo "allocation.sh: $system: not a batch system; allowed: slurm, oar, pbs, and ssh" >&2
        exit 2
        ;;
esac

clearcap run "$CAMPAIGN" --store "$STORE" --scheduler "$file" \
    --tls-ca "$tls/ca.pem" --tls-cert "$tls/client.pem" --tls-key "$tls/client.key" &
campaign=$!
pids+=("$campaign")
status=0
wait -n "$scheduler" "$campaign" || status=$?
if kill -0 "$campaign" 2>/dev/null; then
    echo "allocation.sh: dask scheduler has ended with status $status; see its message above" >&2
    exit 1
fi
status=0
wait "$campaign" || status=$?
end_cluster
(exit "$status")
