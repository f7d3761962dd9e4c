#!/usr/bin/env bash
# The Debian package, judged by tools that others wrote and by its whole life in a bare Debian 12: lintian; installed by apt, a
# simulated arm moved, units verified, upgraded, removed and purged; and the tarball, by the line that docs/start/install.md has.
# Needs root, cargo-deb, dpkg-dev, lintian, debootstrap and a mirror (FORETRACE_DEBIAN_MIRROR, else that of apt's sources of this
# machine, else Debian's own). What is missing is said as "skipped:", and the script leaves with 0. A chroot is kept in target/package/bookworm.tar for the next time. FORETRACE_PACKAGE=1: packages
# that are there already are taken and not built again.
set -euo pipefail
cd "$(dirname "$0")/../.."
out=$PWD/target/package
skip() { echo "skipped: package: $1"; exit 0; }
say() { printf '== %s\n' "$*"; }
for tool in cargo-deb:cargo-deb dpkg-shlibdeps:dpkg-dev lintian:lintian debootstrap:debootstrap systemd-analyze:systemd; do
  command -v "${tool%%:*}" >/dev/null || skip "there is no ${tool%%:*} (${tool#*:})"
done
((EUID == 0)) || skip "a chroot needs root"

version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
deb=$out/foretrace_$version-1_$(dpkg --print-architecture).deb
if [[ ${FORETRACE_PACKAGE:-0} != 1 || ! -e $deb ]]; then
  client/cli/package/build
fi

say "lintian: clean but for the overrides, which say why"
lintian --allow-root --fail-on error,warning --tag-display-limit 0 "$deb"

say "the next version, to upgrade to"
next=$out/next
rm -rf "$next" && mkdir -p "$next"
dpkg-deb -R "$deb" "$next/tree"
sed -i "s/^Version: .*/Version: $version-2/" "$next/tree/DEBIAN/control"
dpkg-deb --root-owner-group -b "$next/tree" "$next" >/dev/null
upgrade=$(echo "$next"/*.deb)

say "a bare Debian 12"
mirror=${FORETRACE_DEBIAN_MIRROR:-$(apt-get indextargets --format '$(REPO_URI)' 2>/dev/null | sed -n 1p || true)}
base=$out/bookworm.tar
if [[ ! -e $base ]]; then
  found=0
  for source in ${mirror:+"$mirror"} http://deb.debian.org/debian; do
    rm -rf "$out/base"
    if debootstrap --variant=minbase bookworm "$out/base" "$source" >"$out/debootstrap.log" 2>&1; then
      found=1
      break
    fi
  done
  ((found)) || skip "debootstrap found no Debian 12: $(tail -1 "$out/debootstrap.log")"
  tar -C "$out/base" -cf "$base" . && rm -rf "$out/base"
fi
mounted=()
roots=()
leave() {
  for ((index = ${#mounted[@]} - 1; index >= 0; index--)); do umount "${mounted[index]}" || umount -l "${mounted[index]}"; done
  for folder in "${roots[@]}"; do rm -rf --one-file-system "$folder"; done
}
trap leave EXIT
# A new one, in $root.
unpack() {
  root=$(mktemp -d)
  roots+=("$root")
  tar -C "$root" -xf "$base"
  cp /etc/resolv.conf "$root/etc/resolv.conf"
  # Whatever lets apt of this machine through (proxies, certificates).
  cp -a /etc/apt/apt.conf.d/. "$root/etc/apt/apt.conf.d/" 2>/dev/null || true
  mount -t proc proc "$root/proc" && mounted+=("$root/proc")
  mount -t tmpfs -o mode=1777 tmpfs "$root/dev/shm" && mounted+=("$root/dev/shm")
  in_root apt-get -q update >"$out/apt.log" 2>&1 || skip "apt in the chroot finds no mirror: $(tail -1 "$out/apt.log")"
}
in_root() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"; }
packages() { in_root dpkg-query -W -f '${Package}\n' | sort; }
unpack
files() { (cd "$root" && find . -xdev -path ./proc -prune -o -path ./var/cache -prune -o -path ./var/lib/apt -prune -o -path ./var/log -prune -o -print | sort); }

cp "$deb" "$upgrade" "$root/root/"
say "the first of two commands: apt install"
# Nothing is installed before it: what the package needs, its own dependencies must bring.
packages >"$out/packages"
in_root apt-get -qy --no-install-recommends install "/root/$(basename "$deb")" | tail -3

say "the second: a simulated arm that moves"
in_root foretrace demo --seconds 5 --no-rights --out /root/report --json /root/demo.json | tail -12
python3 .ci/check_demo.py "$root/root/demo.json"

say "what came with it"
in_root foretrace --version
in_root foretraced --version
in_root getent passwd foretrace
[[ $(in_root readlink /usr/bin/foretraced) == foretrace ]]
for file in usr/share/man/man1/foretrace.1.gz usr/share/man/man1/foretrace-status.1.gz usr/share/bash-completion/completions/foretrace \
  usr/share/zsh/vendor-completions/_foretrace usr/share/fish/vendor_completions.d/foretrace.fish usr/include/foretrace/foretrace.h \
  usr/lib/libforetrace.so usr/lib/libforetrace.a usr/lib/pkgconfig/foretrace.pc etc/security/limits.d/foretrace.conf \
  usr/lib/udev/rules.d/70-foretrace-tablet.rules usr/lib/tmpfiles.d/foretrace.conf usr/share/foretrace/presets/ur5.toml \
  usr/share/doc/foretrace/examples/c/tablet_reader.c usr/share/doc/foretrace/examples/python/write_circle.py; do
  [[ -e $root/$file ]] || { echo "$file is not there" >&2; exit 1; }
done
grep -q 'TAG+="uaccess"' "$root/usr/lib/udev/rules.d/70-foretrace-tablet.rules"
grep -q '^serde .*MIT' "$root/usr/share/doc/foretrace/THIRD-PARTY"
grep -q 'three.js authors' "$root/usr/share/doc/foretrace/copyright"
in_root bash -c '. /usr/share/bash-completion/completions/foretrace && complete -p foretrace' | grep -q ' foretrace$'
in_root foretrace config check /usr/share/foretrace/presets/ur5.toml
if in_root foretrace service install --yes >/dev/null 2>"$out/refused"; then echo "a service was installed without systemd" >&2; exit 1; fi
grep -q "systemd does not run" "$out/refused"

say "units: verified, and as sealed as those of the tree"
# Unknown keys are only warnings to systemd, which does not tell them by its status.
verified() {
  local file=$1
  shift
  said=$(systemd-analyze verify "$@" --man=no "$file" 2>&1) || { printf '%s: refused\n%s\n' "$file" "$said" >&2; exit 1; }
  ! grep -F "$(basename "$file")" <<<"$said" >&2 || exit 1
}
for unit in foretraced foretrace-gateway; do
  file=$root/usr/lib/systemd/system/$unit.service
  copy=$out/$unit.service
  sed 's|^ExecStart=/usr/bin/\S*|ExecStart=/bin/true|' "$file" >"$copy"
  grep -q '^ExecStart=/usr/bin/' "$file"
  verified "$copy"
  systemd-analyze security --offline=true --no-pager --threshold=12 "$copy" | tail -1
done
# The user's unit of `foretrace service install --user`.
in_root foretrace service install --user --dry-run | sed -n '/^# Written/,/^WantedBy/p' | sed 's|^ExecStart=.*|ExecStart=/bin/true|' >"$out/user.service"
grep -q '^WatchdogSec=' "$out/user.service"
export XDG_RUNTIME_DIR=$next
verified "$out/user.service" --user
unset XDG_RUNTIME_DIR
# The judge judges: a word that systemd does not know is told.
sed 's/^Type=.*/Type=nonsense/' "$out/foretraced.service" >"$out/wrong.service"
if (verified "$out/wrong.service") 2>/dev/null; then echo "systemd-analyze finds nothing wrong with a wrong unit" >&2; exit 1; fi

say "upgraded, with a change of the administrator kept"
echo '# mine' >>"$root/etc/security/limits.d/foretrace.conf"
in_root apt-get -qy --no-install-recommends install "/root/$(basename "$upgrade")" | tail -2
in_root dpkg-query -W -f '${Version} ${Status}\n' foretrace | grep "$version-2 install ok installed"
grep -q '# mine' "$root/etc/security/limits.d/foretrace.conf"
in_root foretrace --version

say "removed: only settings are left; purged: nothing"
in_root apt-get -qy remove foretrace | tail -1
[[ ! -e $root/usr/bin/foretrace && -e $root/etc/security/limits.d/foretrace.conf ]]
in_root apt-get -qy purge foretrace | tail -1
rm -rf "$root/root/report" "$root/root/demo.json" "$root"/root/foretrace_*.deb
files >"$out/after"
packages | comm -13 "$out/packages" - >"$out/needed"

say "the same without the package: what it needed, and nothing else"
unpack
xargs -r -a "$out/needed" chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive \
  apt-get -qy --no-install-recommends install >>"$out/apt.log" 2>&1
files >"$out/before"
# The system user stays, as Debian's policy allows: its lines are in files that were there before, or their backups.
left=$(comm -13 "$out/before" "$out/after" | grep -vE '^\./(etc/(passwd|group|shadow|gshadow)-?|etc/ld\.so\.cache|var/lib/dpkg/.*|tmp|run/lock|etc/\.pwd\.lock)$' || true)
[[ -z $left ]] || { printf 'left behind:\n%s\n' "$left" >&2; exit 1; }

say "the tarball, as docs/start/install.md has it"
cp "$out/foretrace-$version-$(uname -m)-linux-gnu.tar.gz" "$root/root/"
# As if a user had made /usr/local readable for everybody only.
chmod 775 "$root/usr/local"
state=$(stat -c '%u:%g %a' "$root/usr/local" "$root/usr/local/bin" "$root/usr/local/share")
line=$(sed -n '/^## Tarball/,/^## /p' docs/start/install.md | sed -n '/^```/,/^```/p' | grep -v '^```' | sed 's/^sudo //')
[[ $line == *tar*--no-overwrite-dir* ]]
in_root bash -euc "cd /root; $line"
[[ $(stat -c '%u:%g %a' "$root/usr/local" "$root/usr/local/bin" "$root/usr/local/share") == "$state" ]]
[[ -z $(find "$root/usr/local" ! -user 0 -o ! -group 0 ! -group staff) ]]
in_root /usr/local/bin/foretraced --version
[[ ! -e $root/usr/local/README.md && -e $root/usr/local/share/doc/foretrace/THIRD-PARTY ]]

say "completions and man pages, read by zsh, fish and man"
share=$out/root/usr/share
if in_root apt-get -qy --no-install-recommends install zsh fish man-db groff-base >>"$out/apt.log" 2>&1; then
  place=$root/root/share
  mkdir "$place"
  cp -a "$share/zsh" "$share/fish" "$share/man" "$place/"
  in_root zsh -n /root/share/zsh/vendor-completions/_foretrace
  in_root fish -n /root/share/fish/vendor_completions.d/foretrace.fish
  for page in "$place"/man/man1/*; do
    said=$(in_root env MANROFFSEQ= MANWIDTH=80 man --warnings -E UTF-8 -l -Tutf8 -Z "/root/share/man/man1/$(basename "$page")" 2>&1 >/dev/null)
    [[ -z $said ]] || { printf '%s: %s\n' "$(basename "$page")" "$said" >&2; exit 1; }
  done
else
  echo "skipped: package: zsh, fish and man are not to be had: completions and man pages were not read"
fi
say "package: everything passed"
