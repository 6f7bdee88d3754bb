#!/usr/bin/env bash
# Makes the image with what is on this machine: cargo, and a Docker engine. No registry is asked.
#
#   deploy/image.sh                          the image `cyclorama`, with a static release build
#   deploy/image.sh --tag cyclorama:test     of another name
#   deploy/image.sh --binary FILE            with this program; if it isn't static, with the libraries that it needs
#   deploy/image.sh --files DIR              only lays out the image's files, in DIR/root and DIR/home
set -euo pipefail

tag=cyclorama binary= files=
while [ $# -gt 0 ]; do
    case $1 in
    --tag) tag=$2 ;;
    --binary) binary=$2 ;;
    --files) files=$2 ;;
    *) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
    esac
    shift 2
done
deploy=$(cd "$(dirname "$0")" && pwd)
. "$deploy/libraries.sh"

if [ -z "$binary" ]; then
    # Without windows: a static program can't load the X libraries. Nearly all else is as `cargo build --release` has built it, and used.
    cd "$deploy/.."
    cargo rustc --release --locked -p cyclorama --no-default-features --features console,import,otlp --bin cyclorama -- -C target-feature=+crt-static
    binary=${CARGO_TARGET_DIR:-target}/release/cyclorama
fi

is_wanted=
if [ -z "$files" ]; then
    is_wanted=yes
    files=$(mktemp -d)
    trap 'rm -rf "$files"' EXIT
fi
# Root owns the program; the user of the image what is in `home`, of which the folders are where volumes are mounted.
mkdir -p "$files/root" "$files/home"/{keys/{authority,manager,compositor,board},scenes,out,tmp}
chmod 0700 "$files/home/keys" "$files/home/keys"/*
cp "$binary" "$files/root/cyclorama"
chmod 0755 "$files/root/cyclorama"
with_libraries "$binary" "$files/root"
# Line tables are for debuggers, and most of the size.
if command -v strip >/dev/null; then strip "$files/root/cyclorama"; fi
if [ -n "$is_wanted" ]; then
    # Engines without BuildKit make every stage of a file, and the one that compiles needs an image from somewhere.
    {
        sed '/^FROM \${BUILDER}/,$d' "$deploy/Dockerfile"
        printf '%s\n' 'COPY root/ /' 'COPY --chown=65532:65532 home/ /'
    } | docker build --quiet --tag "$tag" --file - "$files" >/dev/null
    docker image inspect --format '{{index .RepoTags 0}}: {{.Size}} bytes' "$tag"
fi
