#!/usr/bin/env bash
# Installs a package in a copy-on-write view of this machine, looks, and purges it: what is then left is what the view differs by.
# Run by package.rs, as root and in a mount namespace of its own.
set -euo pipefail
package=$1 view=$2
mount -t tmpfs none "$view"
mkdir "$view"/{changed,work,root}
mount -t overlay overlay -o "lowerdir=/,upperdir=$view/changed,workdir=$view/work" "$view/root"
mount -t proc none "$view/root/proc"
mount -t tmpfs none "$view/root/run"
mount --rbind /dev "$view/root/dev"
mount -t tmpfs none "$view/root/tmp"
cp "$package" "$view/root/tmp/package.deb"
inside() { chroot "$view/root" "$@"; }
# It is neither there before nor in what the machine remembers of packages.
inside dpkg --purge cyclorama 2>/dev/null || true

inside dpkg --install /tmp/package.deb
inside runuser -u cyclorama -- cyclorama --version
inside stat -c '%U %a %n' /etc/cyclorama/keys | grep -x 'cyclorama 700 /etc/cyclorama/keys'
# With the manual's pages that units name.
for unit in manager compositor channel@1; do
    said=$(inside systemd-analyze verify "cyclorama-$unit.service" 2>&1) && [ -z "$said" ] || { echo "$unit: $said" >&2; exit 1; }
done
inside bash -n /usr/share/bash-completion/completions/cyclorama
inside man --path cyclorama-keys-issue
inside cyclorama check /etc/cyclorama/rig.toml

# What its owner has changed survives an upgrade and a removal, and keys survive all.
echo '#CYCLORAMA_THREADS=3' >>"$view/root/etc/default/cyclorama-channel"
echo secret >"$view/root/etc/cyclorama/keys/key.pem"
inside dpkg --install /tmp/package.deb
grep -q THREADS=3 "$view/root/etc/default/cyclorama-channel"
inside dpkg --remove cyclorama
grep -q THREADS=3 "$view/root/etc/default/cyclorama-channel"
[ ! -e "$view/root/usr/bin/cyclorama" ]
inside dpkg --purge cyclorama
[ "$(cat "$view/root/etc/cyclorama/keys/key.pem")" = secret ]
rm -r "$view/root/etc/cyclorama"

# The user stays, as Debian's do: files that it owned would become somebody else's.
left=$(cd "$view/changed" && find . ! -type d ! -path './var/lib/dpkg/*' ! -path './var/log/*' ! -path './var/cache/*' \
    ! -path './etc/passwd*' ! -path './etc/group*' ! -path './etc/shadow*' ! -path './etc/gshadow*' ! -path './etc/.pwd.lock')
[ -z "$left" ] || { echo "left: $left" >&2; exit 1; }
if find "$view/changed" -name '*cyclorama*' ! -path '*/var/cache/man/*' | grep .; then exit 1; fi
