#!/usr/bin/env bash
# Builds the image with PostgreSQL's and Dask's packages and runs what compose.cluster.yaml says, each container with an
# address of its own on a network that leads nowhere else: a proxy, two services, a scheduler and two workers. The
# PostgreSQL server is that of the test environment. Run it by `make image-test`; docker/test/common.sh says what it needs.
set -euo pipefail
cd "$(dirname "$0")/.."

declare -A packages=([ip]=iproute2 [dnsmasq]=dnsmasq-base)
# shellcheck source=docker/test/common.sh
source docker/test/common.sh
compose=docker/compose.cluster.yaml
name=iso$$
subnet=172.30.99
declare -A started=() addresses=([postgres]=$subnet.1 [scheduler]=$subnet.2 [worker-1]=$subnet.11 [worker-2]=$subnet.12
    [isoshape-1]=$subnet.21 [isoshape-2]=$subnet.22 [proxy]=$subnet.31)

clean_up() {
    for role in "${!started[@]}"; do runtime delete --force "$name-$role" >/dev/null 2>&1 || true; done
    for role in "${!addresses[@]}"; do
        if [[ -e /run/netns/$name-$role ]]; then
            ip netns pids "$name-$role" | xargs --no-run-if-empty kill || true
        fi
    done
    wait
    for role in "${!addresses[@]}"; do ip netns delete "$name-$role" 2>/dev/null || true; done
    $BUILDAH rm --all >/dev/null 2>&1 || true
    $BUILDAH rmi localhost/isoshape-cluster >/dev/null 2>&1 || true
    if ((failed)); then
        for log in "$work"/*.log; do
            say "the last lines of ${log##*/}:"
            tail -n 20 "$log"
        done
    fi
    rm -rf "$work"
}
trap clean_up EXIT

say '== the image of a cluster'
build localhost/isoshape-cluster --build-arg LOCK=docker/cluster.lock
$BUILDAH inspect --type image localhost/isoshape-cluster >"$work/isoshape.json"
root=$($BUILDAH mount "$($BUILDAH from --pull-never localhost/isoshape-cluster)")
pass "docker/Dockerfile builds with docker/cluster.lock: $(du -sm "$root" | cut -f 1) MiB"
proxy=$("$python" -c 'import sys, yaml; print(yaml.safe_load(sys.stdin)["services"]["proxy"]["image"])' <$compose)
docker/test/base_image.sh "$proxy"
$BUILDAH inspect --type image "localhost/$proxy" >"$work/proxy.json"
proxy_root=$($BUILDAH mount "$($BUILDAH from --pull-never "localhost/$proxy")")

say '== the network'
# One bridge in the database's network, a wire from each container's to it, and in each the name server that Docker has.
for role in "${!addresses[@]}"; do
    ip netns add "$name-$role"
    ip -n "$name-$role" link set lo up
    printf '%s %s\n' "${addresses[$role]}" "${role%-[0-9]}" >>"$work/hosts"
done
hub=$name-postgres
ip -n "$hub" link add name hub type bridge
ip -n "$hub" address add "${addresses[postgres]}/24" dev hub
ip -n "$hub" link set hub up
wires=0
for role in "${!addresses[@]}"; do
    [[ $role != postgres ]] || continue
    wires=$((wires + 1))
    ip -n "$hub" link add "wire$wires" type veth peer name eth0 netns "$name-$role"
    ip -n "$hub" link set "wire$wires" master hub up
    ip -n "$name-$role" address add "${addresses[$role]}/24" dev eth0
    ip -n "$name-$role" link set eth0 up
    ip netns exec "$name-$role" dnsmasq --keep-in-foreground --no-resolv --no-hosts --local=/#/ --addn-hosts="$work/hosts" \
        --listen-address=127.0.0.11 --bind-interfaces --pid-file --user=root >>"$work/names.log" 2>&1 9>&- &
done
echo 'nameserver 127.0.0.11' >"$work/resolv.conf"

# A new volume takes what the image has there: its owner.
install -d -o 10001 -g 10001 "$work/jobs"

# start ROLE SERVICE IMAGE ROOT: a container, and the wait until its health check says that it is well.
start() {
    local role=$1 service=$2 began=$SECONDS health
    mkdir -p "$work/$role"
    "$python" docker/test/bundle.py $compose "$service" "$work/$3.json" "$4" "$work/$role" \
        --network "/run/netns/$name-$role" --resolver "$work/resolv.conf" --volume "jobs=$work/jobs"
    runtime run --bundle "$work/$role" --pid-file "$work/$role.pid" "$name-$role" \
        </dev/null >>"$work/$role.log" 2>&1 9>&- &
    started[$role]=$!
    mapfile -t health < <("$python" -c '
import sys, yaml
check = yaml.safe_load(open(sys.argv[1]))["services"][sys.argv[2]]["healthcheck"]
print(*check.get("test", ["CMD", "true"])[1:], sep="\n")' $compose "$service")
    until [[ -s $work/$role.pid ]] && runtime exec --no-new-privs --user 10001:10001 "$name-$role" "${health[@]}" \
        >/dev/null 2>&1; do
        kill -0 "${started[$role]}" 2>/dev/null || fail "$role ended before it was ready"
        ((SECONDS - began < 180)) || fail "$role was not ready within 180 s"
        sleep 0.5
    done
}
outside() { ip netns exec "$hub" "$@"; }
client() { outside "$python" docker/test/client.py "$@"; }
status() { outside curl --silent --output /dev/null --write-out '%{http_code}' --max-time 10 "$@"; }

say '== the containers'
if "$python" docker/test/bundle.py $compose isoshape "$work/isoshape.json" "$root" "$work" --volume "jobs=$work/jobs" \
    2>"$work/refused"; then
    fail 'the compose file asks for no password'
fi
grep -q 'POSTGRES_PASSWORD: ' "$work/refused" || fail "the compose file was refused for another reason: $(<"$work/refused")"
POSTGRES_PASSWORD=$(od -An -N16 -tx1 /dev/urandom | tr -d ' ')
read -r ISOSHAPE_API_KEY ISOSHAPE_API_KEYS < <("$python" -m service.cli key | awk '{print $2}' | xargs)
export POSTGRES_PASSWORD ISOSHAPE_API_KEY ISOSHAPE_API_KEYS

mkdir "$work/database"
outside "$python" docker/test/database.py $compose "$work/database" "${addresses[postgres]}" \
    >"$work/database.log" 2>&1 9>&- &
start scheduler scheduler isoshape "$root"
for i in 1 2; do start worker-$i worker isoshape "$root"; done
for i in 1 2; do start isoshape-$i isoshape isoshape "$root"; done
pass 'the scheduler, two workers and two services are ready, by the health checks of compose.cluster.yaml'
start proxy proxy proxy "$proxy_root"
pass 'the proxy takes docker/nginx.conf, and reaches a service'

for role in scheduler worker-1 worker-2 isoshape-1 isoshape-2; do
    "$python" docker/test/confined.py "$(<"$work/$role.pid")" 10001 || fail "a process of $role may do more than it should"
done
"$python" docker/test/confined.py "$(<"$work/proxy.pid")" 101 || fail 'a process of the proxy may do more than it should'
pass 'every process is of its own user, without capabilities, and can gain none'

through=http://${addresses[proxy]}:8080
[[ $(status "$through/shapes") == 401 ]] || fail 'a request without a key is answered'
client "$through" fill
pass 'through the proxy, uploads and queries answer'
for i in 1 2; do client "http://${addresses[isoshape-$i]}:8000" again >"$work/answers-$i"; done
cmp <(sed '/answered in/d' "$work/answers-1") <(sed '/answered in/d' "$work/answers-2") || fail 'the services answer differently'
pass 'both services answer with all that was stored, and alike'

runtime kill "$name-worker-1" KILL
client "$through" again
pass 'with one of the workers killed, queries answer'
runtime kill "$name-isoshape-1" KILL
for _ in 1 2 3; do client "$through" again >/dev/null || fail 'the proxy keeps to a service that has gone'; done
pass 'with one of the services killed, the proxy goes to the other'

for role in isoshape-2 worker-2 scheduler; do
    runtime kill "$name-$role" TERM
    wait "${started[$role]}" && ended=0 || ended=$?
    ((ended == 0)) || fail "asked to stop, $role ended with $ended"
done
pass 'asked to stop, they end by themselves'

failed=0
say 'The image of a cluster builds, and runs as compose.cluster.yaml says.'
