"""Write the configuration that an OCI runtime starts a built image with, as a compose file asks for it.

``bundle.py COMPOSE SERVICE IMAGE ROOT BUNDLE``: the compose file, and which of its services; the image's
configuration, as ``buildah inspect`` prints it; the mounted root of a container of it; the folder to write
``config.json`` to. ``--volume NAME=FOLDER`` says what stands for a volume, ``--resolver FILE`` what is
``/etc/resolv.conf``. Unless ``--network FILE`` names another, the container has a network of its own with
nothing but the loopback in it, so a service that asked for anything from outside would fail. Limits of memory
and of processes need control groups and are not set here.
"""

import argparse
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml


def mount(kind: str, destination: str, *options: str) -> dict[str, Any]:
    """A file system of the kernel's at a place in the container."""
    return {"destination": destination, "type": kind, "source": kind, "options": list(options)}


KERNEL = [
    mount("proc", "/proc"),
    mount("tmpfs", "/dev", "nosuid", "mode=755", "size=64m"),
    mount("devpts", "/dev/pts", "nosuid", "noexec", "newinstance", "mode=0620"),
    mount("tmpfs", "/dev/shm", "nosuid", "noexec", "nodev", "mode=1777", "size=64m"),
    mount("mqueue", "/dev/mqueue", "nosuid", "noexec", "nodev"),
]
HIDDEN = [f"/proc/{name}" for name in ("acpi", "kcore", "keys", "latency_stats", "sched_debug", "timer_list")]
FIXED = ["/proc/bus", "/proc/fs", "/proc/irq", "/proc/sys", "/proc/sysrq-trigger"]
CAPABILITY_SETS = ("bounding", "effective", "inheritable", "permitted", "ambient")


# ${NAME:?what to say when it is missing} and ${NAME:-what stands for it}, as Compose reads them.
VARIABLE = re.compile(r"\$\{(\w+):([?-])([^}]*)\}")


def interpolated(value: str) -> str:
    """A value of the compose file with the variables of this environment in it."""

    def replaced(found: re.Match[str]) -> str:
        name, kind, text = found.groups()
        if given := os.environ.get(name):
            return given
        if kind == "?":
            raise SystemExit(f"{name}: {text}")
        return text

    return VARIABLE.sub(replaced, value)


def mounts(
    service: dict[str, Any], folder: Path, volumes: dict[str, str], resolver: Path | None
) -> Iterator[dict[str, Any]]:
    """The service's tmpfs and volumes, with the options that Docker gives each."""
    yield from KERNEL
    for entry in service.get("tmpfs", []):
        path, _, options = entry.partition(":")
        yield mount("tmpfs", path, "nosuid", "nodev", "noexec", *filter(None, options.split(",")))
    for entry in service.get("volumes", []):
        source, destination, *options = entry.split(":")
        where = str((folder / source).resolve()) if source.startswith(".") else volumes[source]
        yield bind(where, destination, *(options or ["rw"]))
    if resolver is not None:
        yield bind(str(resolver), "/etc/resolv.conf", "ro")


def bind(source: str, destination: str, *options: str) -> dict[str, Any]:
    """A file or folder of this machine at a place in the container."""
    return {"destination": destination, "type": "bind", "source": str(source), "options": ["rbind", *options]}


def configuration(
    service: dict[str, Any],
    image: dict[str, Any],
    root: Path,
    mounted: list[dict[str, Any]],
    network: dict[str, str],
) -> dict[str, Any]:
    """The runtime's ``config.json`` for the image run as the service."""
    user, _, group = (service.get("user") or image["User"]).partition(":")
    kept: list[str] = [] if service.get("cap_drop") == ["ALL"] else ["CAP_CHOWN", "CAP_SETUID", "CAP_SETGID"]
    given = {name: interpolated(str(value)) for name, value in service.get("environment", {}).items()}
    return {
        "ociVersion": "1.0.0",
        "process": {
            "terminal": False,
            "user": {"uid": int(user), "gid": int(group)},
            "args": [*(image.get("Entrypoint") or []), *(service.get("command") or image["Cmd"])],
            "env": image["Env"] + [f"{name}={value}" for name, value in given.items()],
            "cwd": service.get("working_dir") or image.get("WorkingDir") or "/",
            "capabilities": dict.fromkeys(CAPABILITY_SETS, kept),
            "noNewPrivileges": "no-new-privileges:true" in service.get("security_opt", []),
        },
        "root": {"path": str(root), "readonly": service.get("read_only", False)},
        "hostname": "isoshape",
        "mounts": mounted,
        "linux": {
            "namespaces": [*({"type": kind} for kind in ("pid", "ipc", "uts", "mount")), network],
            "maskedPaths": HIDDEN,
            "readonlyPaths": FIXED,
        },
    }


def main() -> None:
    """Write what the arguments ask for."""
    parser = argparse.ArgumentParser()
    for name in ("compose", "service", "image", "root", "bundle"):
        parser.add_argument(name, type=str if name == "service" else Path)
    parser.add_argument("--volume", action="append", default=[])
    parser.add_argument("--resolver", type=Path)
    parser.add_argument("--network")
    asked = parser.parse_args()
    service = yaml.safe_load(asked.compose.read_text())["services"][asked.service]
    image = json.loads(asked.image.read_text())["Docker"]["config"]
    volumes = dict(volume.split("=", 1) for volume in asked.volume)
    mounted = list(mounts(service, asked.compose.parent, volumes, asked.resolver))
    network = {"type": "network"} | ({"path": asked.network} if asked.network else {})
    made = configuration(service, image, asked.root, mounted, network)
    (asked.bundle / "config.json").write_text(json.dumps(made, indent=2))


if __name__ == "__main__":
    main()
