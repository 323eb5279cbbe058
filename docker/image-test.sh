#!/usr/bin/env bash
# Builds the image from its Dockerfile and runs it as compose.yaml says: as its own user, on a read-only root, without
# capabilities. Run it by `make image-test`; docker/test/common.sh says what it needs.
set -euo pipefail
cd "$(dirname "$0")/.."

declare -A packages=()
# shellcheck source=docker/test/common.sh
source docker/test/common.sh
name=isoshape-image-test-$$

# crun runs what is added as root unless told: as the image's own user, then, and with no more than it may.
inside() { runtime exec --user "$user" --no-new-privs "$name" "$@"; }

clean_up() {
    runtime delete --force "$name" >/dev/null 2>&1 || true
    $BUILDAH rm --all >/dev/null 2>&1 || true
    $BUILDAH rmi localhost/isoshape >/dev/null 2>&1 || true
    if ((failed)) && [[ -s $work/log ]]; then
        say 'the last lines that the service wrote:'
        tail -n 40 "$work/log"
    fi
    rm -rf "$work"
}
trap clean_up EXIT

say '== the files'
tools=$kept/tools-$(sha256sum docker/test/requirements.lock | cut -c 1-16)
if [[ ! -e $tools/.made ]]; then
    "$python" -m venv --clear "$tools"
    "$tools/bin/python" -m pip -qq --disable-pip-version-check install --require-hashes \
        --requirement docker/test/requirements.lock
    touch "$tools/.made"
fi
"$tools/bin/hadolint" docker/Dockerfile
pass 'hadolint finds nothing in docker/Dockerfile'
"$tools/bin/python" -c 'import sys; from compose_spec import PyCompose; PyCompose.from_yaml(sys.stdin.read())' \
    <docker/compose.yaml
pass 'docker/compose.yaml keeps to the Compose specification'
"$python" -c 'import sys, yaml; print(yaml.safe_dump(yaml.safe_load(sys.stdin)))' <docker/compose.cluster.yaml |
    "$tools/bin/python" -c 'import sys; from compose_spec import PyCompose; PyCompose.from_yaml(sys.stdin.read())'
pass 'docker/compose.cluster.yaml keeps to the Compose specification'

say '== the build'
build localhost/isoshape
$BUILDAH inspect --type image localhost/isoshape >"$work/image.json"
container=$($BUILDAH from --pull-never localhost/isoshape)
root=$($BUILDAH mount "$container")
pass "docker/Dockerfile builds: $(du -sm "$root" | cut -f 1) MiB"
"$python" - "$work/image.json" <<'END' || fail 'the image tells of the machine it was built on, or lacks its health check'
import json, sys

image = json.load(open(sys.argv[1]))
config = image["Docker"]["config"]
assert config["Healthcheck"]["Test"][0] == "CMD", config
assert config["User"] == "10001:10001", config
strangers = [line for line in config["Env"] if line.startswith(("PIP_", "SSL_", "REQUESTS_", "UV_"))]
assert not strangers, strangers
END
(cd "$root/opt/isoshape/lib/python3"*/site-packages && [[ -d core && -d service && ! -e tests && ! -e pip ]]) ||
    fail 'the image holds something other than the project and what it runs on'
plain=$($BUILDAH from --pull-never "$base")
cmp "$($BUILDAH mount "$plain")$certificates" "$root$certificates" || fail 'the image keeps the certificates it was lent'
$BUILDAH rm "$plain" >/dev/null
pass 'the image holds no tests, no pip and nothing of this machine'

say '== the container'
user=$("$python" -c 'import json, sys; print(json.load(open(sys.argv[1]))["Docker"]["config"]["User"])' "$work/image.json")
# A new volume takes what the image has there: its owner and its mode.
cp -a "$root/data" "$work/data"
mkdir "$work/bundle"
bundle=("$python" docker/test/bundle.py docker/compose.yaml isoshape "$work/image.json" "$root" "$work/bundle"
    --volume "data=$work/data")
if "${bundle[@]}" 2>"$work/refused"; then fail 'the compose file asks for no key'; fi
grep -q '^ISOSHAPE_API_KEYS: ' "$work/refused" || fail "the compose file was refused for another reason: $(<"$work/refused")"
read -r ISOSHAPE_API_KEY ISOSHAPE_API_KEYS < <("$python" -m service.cli key | awk '{print $2}' | xargs)
export ISOSHAPE_API_KEY ISOSHAPE_API_KEYS
"${bundle[@]}"
mapfile -t health < <("$python" -c '
import sys, yaml
print(*yaml.safe_load(open("docker/compose.yaml"))["services"]["isoshape"]["healthcheck"]["test"][1:], sep="\n")')

client() { nsenter --target "$pid" --net -- "$python" docker/test/client.py http://127.0.0.1:8000 "$@"; }
start() {
    local began=$SECONDS
    runtime run --bundle "$work/bundle" --pid-file "$work/pid" "$name" </dev/null >>"$work/log" 2>&1 9>&- &
    running=$!
    until [[ -s $work/pid ]] && inside "${health[@]}" >/dev/null 2>&1; do
        kill -0 "$running" 2>/dev/null || fail 'the service ended before it was ready'
        ((SECONDS - began < 120)) || fail 'the service was not ready within 120 s'
        sleep 0.5
    done
    pid=$(<"$work/pid")
    pass "ready within $((SECONDS - began)) s, by the image's own health check"
}
stop() {
    runtime kill "$name" "$1"
    wait "$running" && status=0 || status=$?
    runtime delete --force "$name" >/dev/null 2>&1 || true
    rm -f "$work/pid"
}

start
nsenter --target "$pid" --net -- curl --silent --show-error --fail --max-time 10 http://127.0.0.1:8000/readyz >/dev/null
pass '/readyz answers'
keyless=$(nsenter --target "$pid" --net -- curl --silent --output /dev/null --write-out '%{http_code}' --max-time 10 \
    http://127.0.0.1:8000/shapes)
[[ $keyless == 401 ]] || fail "a request without a key is answered $keyless"
pass 'a request without a key is answered 401'

"$python" docker/test/confined.py "$pid" 10001 || fail 'a process of the service may do more than it should'
pass 'every process is of user 10001, without capabilities, and can gain none'

for folder in / /opt/isoshape /usr/local/bin /etc; do
    if inside sh -c "touch $folder/written" 2>"$work/refused"; then fail "$folder can be written to"; fi
    grep -q 'Read-only file system' "$work/refused" || fail "writing to $folder failed for another reason: $(<"$work/refused")"
done
inside sh -c 'touch /data/written /tmp/written && rm /data/written /tmp/written' || fail '/data and /tmp cannot be written to'
pass 'the root is read-only; /data and /tmp can be written to'

client fill
pass 'uploads and queries answer'

inside diff -r /opt/isoshape/kernels /tmp/numba >/dev/null || fail 'kernels were compiled again at the start'
pass 'the kernels that were compiled with the image are those that ran'

stop KILL
start
client again
pass 'killed and started again, it answers with all that it had acknowledged'

stop TERM
((status == 0)) || fail "asked to stop, it ended with $status"
pass 'asked to stop, it ends by itself'

failed=0
say 'The image builds, and runs as compose.yaml says.'
