#!/usr/bin/env bash
# Makes the Debian package, with Debian's own tools (dpkg-dev).
#
#   deploy/package.sh                    of a release build, in target/debian
#   deploy/package.sh --binary FILE      of this program
#   deploy/package.sh --out DIR          into another folder
set -euo pipefail

binary= out=
while [ $# -gt 0 ]; do
    case $1 in
    --binary) binary=$(realpath "$2") ;;
    --out) out=$(realpath -m "$2") ;;
    *) sed -n '2,/^set/s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
    esac
    shift 2
done
cd "$(dirname "$0")/.."
target=${CARGO_TARGET_DIR:-target}
out=${out:-$(realpath -m "$target/debian")}
if [ -z "$binary" ]; then
    cargo build --release --locked -p cyclorama
    binary=$(realpath "$target/release/cyclorama")
fi

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# As Debian's tools expect it: `debian` with what is said of the package, and below it the package's root.
mkdir "$work/debian"
cp deploy/debian/control "$work/debian/"
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)-1
maintainer=$(sed -n 's/^Maintainer: //p' deploy/debian/control)
printf 'cyclorama (%s) unstable; urgency=medium\n\n  * See /usr/share/doc/cyclorama/changelog.gz.\n\n -- %s  %s\n' \
    "$version" "$maintainer" "$(LC_ALL=C date -R -u -r CHANGELOG.md)" >"$work/debian/changelog"
root=$work/debian/cyclorama

put() { install -D -m 0644 "$1" "$root/$2"; }
install -D -m 0755 "$binary" "$root/usr/bin/cyclorama"
# Line tables are for debuggers, and most of the size.
strip --remove-section=.comment --remove-section=.note "$root/usr/bin/cyclorama"
# Made by the program itself, so that they say what it understands.
"$binary" man "$work/man1" 2>/dev/null
for page in "$work"/man1/*.1; do put "$page" "usr/share/man/man1/${page##*/}"; done
"$binary" completions bash >"$work/bash" && put "$work/bash" usr/share/bash-completion/completions/cyclorama
"$binary" completions zsh >"$work/zsh" && put "$work/zsh" usr/share/zsh/vendor-completions/_cyclorama
"$binary" completions fish >"$work/fish" && put "$work/fish" usr/share/fish/vendor_completions.d/cyclorama.fish
for unit in deploy/systemd/*.service; do put "$unit" "usr/lib/systemd/system/${unit##*/}"; done
put deploy/systemd/cyclorama.sysusers usr/lib/sysusers.d/cyclorama.conf
for file in deploy/systemd/default/*; do put "$file" "etc/default/${file##*/}"; done
put deploy/rigs/annotated.toml etc/cyclorama/rig.toml
for page in README.md docs/*.md; do put "$page" "usr/share/doc/cyclorama/$page"; done
put deploy/debian/copyright usr/share/doc/cyclorama/copyright
put CHANGELOG.md usr/share/doc/cyclorama/changelog
put "$work/debian/changelog" usr/share/doc/cyclorama/changelog.Debian
gzip -9n "$root"/usr/share/man/man1/*.1 "$root"/usr/share/doc/cyclorama/changelog{,.Debian}

mkdir "$root/DEBIAN"
install -m 0755 deploy/debian/{postinst,prerm,postrm} "$root/DEBIAN/"
install -m 0644 deploy/debian/conffiles "$root/DEBIAN/"
(cd "$root" && find usr -type f -print0 | sort -z | xargs -0 md5sum) >"$root/DEBIAN/md5sums"
cd "$work"
dpkg-shlibdeps debian/cyclorama/usr/bin/cyclorama
dpkg-gencontrol -Pdebian/cyclorama
mkdir -p "$out"
dpkg-deb --root-owner-group --build debian/cyclorama "$out"
