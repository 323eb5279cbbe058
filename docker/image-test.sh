#!/usr/bin/env bash
# Builds the image from its Dockerfile and runs it as compose.yaml says: as its own user, on a read-only root, without
# capabilities. No Docker engine is needed: buildah builds, and crun, an OCI runtime, runs. Run it by `make image-test`.
# For root on a Debian system, whose packages it installs when they are missing.
set -euo pipefail
cd "$(dirname "$0")/.."

python=$PWD/.venv/bin/python
kept=/var/cache/isoshape-image-test
work=$(mktemp -d)
name=isoshape-image-test-$$
state=$work/state
failed=1

say() { printf '%s\n' "$*"; }
pass() { printf '%4d s  ok    %s\n' "$SECONDS" "$*"; }
fail() {
    printf '%4d s  FAIL  %s\n' "$SECONDS" "$*" >&2
    exit 1
}

[[ $(id -u) == 0 ]] || fail 'the image is built and run without an engine, and only root can do that: run it as root'
command -v apt-get >/dev/null || fail 'this test installs its tools with apt-get, and there is none: run it on Debian'
[[ -x $python ]] || fail 'there is no environment: run this by make image-test'

missing=()
for tool in buildah crun debootstrap curl; do
    command -v "$tool" >/dev/null || missing+=("$tool")
done
if ((${#missing[@]})); then
    say "installing ${missing[*]}"
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq </dev/null >/dev/null
    apt-get install -qq --yes --no-install-recommends "${missing[@]}" </dev/null >/dev/null
fi

# Storage and a build of their own, so that no image or container of this machine's is touched.
mkdir -p "$kept"
exec 9>"$kept/lock"
flock 9
unset ISOSHAPE_API_KEY ISOSHAPE_API_KEYS ISOSHAPE_READ_KEYS
export BUILDAH_ISOLATION=chroot
export BUILDAH="buildah --root $kept/storage --runroot $work/run"

# The runtime is asked to leave control groups alone, and given a file system without them, since it refuses machines
# that mount both versions.
runtime() {
    # shellcheck disable=SC2016
    unshare --mount --propagation private bash -c \
        'mount -t tmpfs none /sys/fs/cgroup && exec crun --root "$0" --cgroup-manager=disabled "$@"' "$state" "$@"
}
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
base=$(sed -n 's/^FROM \([^ ]*\).*/\1/p' docker/Dockerfile | sort -u)
[[ $(wc -l <<<"$base") == 1 ]] || fail "the Dockerfile has more than one base: $base"
docker/test/base_image.sh "$base"
# A machine behind a proxy of its own trusts that proxy's certificate: lend the build this machine's, and keep none.
lent=()
certificates=/etc/ssl/certs/ca-certificates.crt
if [[ -e $certificates ]]; then lent=(--volume "$certificates:$certificates:ro"); fi
$BUILDAH bud --pull-never --format docker "${lent[@]}" --file docker/Dockerfile --tag localhost/isoshape . \
    </dev/null >"$work/build" 2>&1 || {
    tail -n 40 "$work/build" >&2
    fail 'the image does not build'
}
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
if "$python" docker/test/bundle.py docker/compose.yaml "$work/image.json" "$root" "$work/data" "$work/bundle" 2>"$work/refused"
then fail 'the compose file asks for no key'; fi
grep -q '^ISOSHAPE_API_KEYS: ' "$work/refused" || fail "the compose file was refused for another reason: $(<"$work/refused")"
read -r ISOSHAPE_API_KEY ISOSHAPE_API_KEYS < <("$python" -m service.cli key | awk '{print $2}' | xargs)
export ISOSHAPE_API_KEY ISOSHAPE_API_KEYS
"$python" docker/test/bundle.py docker/compose.yaml "$work/image.json" "$root" "$work/data" "$work/bundle"
mapfile -t health < <("$python" -c '
import sys, yaml
print(*yaml.safe_load(open("docker/compose.yaml"))["services"]["isoshape"]["healthcheck"]["test"][1:], sep="\n")')

client() { nsenter --target "$pid" --net -- "$python" docker/test/client.py "$@"; }
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

"$python" - "$pid" <<'END' || fail 'a process of the service may do more than it should'
import sys
from pathlib import Path

first = Path("/proc", sys.argv[1], "ns/pid").readlink()
found = 0
for process in Path("/proc").glob("[0-9]*"):
    try:
        if (process / "ns/pid").readlink() != first:
            continue
        status = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines())
    except (FileNotFoundError, PermissionError):
        continue  # It has ended, or is no process of the container's.
    found += 1
    wanted = {"Uid": "10001", "Gid": "10001", "CapEff": "0" * 16, "CapPrm": "0" * 16, "CapBnd": "0" * 16, "NoNewPrivs": "1"}
    for key, value in wanted.items():
        assert set(status[key].split()) == {value}, (status["Name"], key, status[key])
assert found, "no process was found"
END
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
