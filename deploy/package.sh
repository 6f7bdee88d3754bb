#!/usr/bin/env bash
# Makes the Debian package, in target/debian. Needs `cargo install cargo-deb`.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
cargo build --release --locked
program=$target/release/cyclorama
# Made by the program itself, so that they say what it understands. Cargo.toml names the folder.
made=$target/release/package
rm -rf "$made" && mkdir -p "$made"
"$program" man "$made/man1"
"$program" completions bash >"$made/cyclorama.bash"
"$program" completions zsh >"$made/_cyclorama"
"$program" completions fish >"$made/cyclorama.fish"
gzip -9n "$made"/man1/*.1
cargo deb --no-build --strip --locked -p cyclorama "$@"
