#!/usr/bin/env bash
# One image per kind of worker: physavatar-vision, physavatar-simulation; no stage uses a GPU. With docker where its daemon answers, else with
# Debian's buildah (chroot isolation, no daemon) on a base that debootstrap makes. KINDS="vision" builds some; BASE=name@sha256:… pins the base.
# Packages come from where this machine's pip gets them: PIP_INDEX_URL, PIP_EXTRA_INDEX_URL, PIP_FIND_LINKS, or `pip config`. With buildah, local
# folders among them and the certificates in PIP_CERT (a network that signs for others) are lent to the build read-only; none ends up in an image.
set -euo pipefail
cd "$(dirname "$0")/.."
version=$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)
kinds=${KINDS:-vision simulation}

for name in INDEX_URL EXTRA_INDEX_URL FIND_LINKS CERT; do
    variable=PIP_$name key=${name,,}
    if [ -z "${!variable+set}" ] && value=$(python3 -m pip config get "global.${key//_/-}" 2>/dev/null); then export "$variable=$value"; fi
done

arguments() {   # build arguments that are set in the environment
    for name in BASE TORCH_INDEX PIP_INDEX_URL PIP_EXTRA_INDEX_URL PIP_FIND_LINKS; do
        if [ -n "${!name+set}" ]; then printf -- '--build-arg\n%s=%s\n' "$name" "${!name}"; fi
    done
}

lent() {   # options of buildah for the folders and the certificates that pip needs from this machine
    local place
    for place in ${PIP_INDEX_URL:-} ${PIP_EXTRA_INDEX_URL:-} ${PIP_FIND_LINKS:-}; do
        place=${place#file://} && place=${place%/simple}   # an index on disk names files beside its folder `simple`
        if [ -d "$place" ]; then printf -- '--volume\n%s:%s:ro\n' "$place" "$place"; fi
    done
    if [ -n "${PIP_CERT:-}" ]; then printf -- '--volume\n%s:/pip-ca.crt:ro\n--build-arg\nPIP_CERT=/pip-ca.crt\n' "$PIP_CERT"; fi
}

storage_driver() {   # overlay where this kernel lets it mount; vfs works everywhere and copies every layer whole
    local container
    if container=$(STORAGE_DRIVER=overlay buildah from scratch 2>/dev/null); then
        STORAGE_DRIVER=overlay buildah mount "$container" >/dev/null 2>&1 && echo overlay || echo vfs
        STORAGE_DRIVER=overlay buildah rm "$container" >/dev/null
    else
        echo vfs
    fi
}

local_base() {   # an image of Debian 12 from debootstrap, once
    local image=localhost/physavatar-base:bookworm
    if ! buildah inspect --type image "$image" >/dev/null 2>&1; then
        local root
        root=${ROOTFS:-$(mktemp -d)}
        [ -e "$root/bin/sh" ] || debootstrap --variant=minbase --include=ca-certificates bookworm "$root" >&2
        local container
        container=$(buildah from scratch)
        buildah add --quiet "$container" "$root" / >/dev/null
        buildah commit --quiet --rm "$container" "$image" >/dev/null
    fi
    echo "$image"
}

if docker info >/dev/null 2>&1; then
    build() { docker build --file "containers/$1.Dockerfile" --tag "physavatar-$1:$version" "${options[@]}" .; }
    size() { docker image inspect --format '{{.Size}}' "physavatar-$1:$version"; }
elif command -v buildah >/dev/null; then
    export BUILDAH_ISOLATION=chroot STORAGE_DRIVER=${STORAGE_DRIVER:-$(storage_driver)}
    [ "$STORAGE_DRIVER" = vfs ] || export BUILDAH_LAYERS=true   # what two images have in common is built once
    [ -n "${BASE+set}" ] || BASE=$(local_base)
    mapfile -t mounts < <(lent)
    build() { buildah build --format docker --network host --file "containers/$1.Dockerfile" --tag "physavatar-$1:$version" "${mounts[@]}" "${options[@]}" .; }
    size() { buildah inspect --type image --format '{{.Size}}' "physavatar-$1:$version" 2>/dev/null || buildah images --format '{{.Size}}' "physavatar-$1:$version"; }
else
    echo "neither a docker daemon nor buildah: apt-get install buildah debootstrap" >&2
    exit 2
fi

mapfile -t options < <(arguments)
for kind in $kinds; do
    build "$kind"
    echo "physavatar-$kind:$version $(size "$kind")"
done
