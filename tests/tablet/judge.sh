#!/usr/bin/env bash
# Virtual pens through a real kernel (client/tablet/tests/uinput.rs): on this machine where /dev/uinput can be opened,
# else in a small virtual machine made from Debian's kernel, which takes about 15 s. Needs for that
# qemu-system-x86_64, busybox (static), cpio, dpkg-deb and apt-get download; where one cannot be had, says so and
# leaves with 0. KERNEL is a folder with an unpacked linux-image package (default: downloaded).
set -euo pipefail
cd "$(dirname "$0")/../.."
built=$(cargo test -p foretrace-tablet --test uinput --no-run --locked --message-format=json |
  python3 -c 'import json,sys; print([m["executable"] for m in map(json.loads, sys.stdin) if m.get("executable") and m["target"]["name"] == "uinput"][-1])')
if [[ -w /dev/uinput ]]; then
  "$built" --test-threads=1
  exit
fi
for tool in qemu-system-x86_64 busybox cpio dpkg-deb apt-get strip; do
  command -v "$tool" >/dev/null || { echo "tablet: skipped: there is no /dev/uinput here, and a virtual machine needs $tool"; exit 0; }
done
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
kernel=${KERNEL:-$scratch/kernel}
if [[ ! -d $kernel ]]; then
  name=$(apt-cache depends linux-image-amd64 2>/dev/null | grep -o 'linux-image-[0-9][^ ]*' | head -1 || true)
  if [[ -z $name ]] || ! (cd "$scratch" && apt-get download -qq "$name" && dpkg-deb -x "$name"*.deb "$kernel") 2>"$scratch/log"; then
    echo "tablet: skipped: Debian's kernel cannot be had here: $(tail -1 "$scratch/log" 2>/dev/null)"
    exit 0
  fi
fi

root=$scratch/root
mkdir -p "$root"/{bin,mod,dev,proc,sys,tmp}
cp "$(command -v busybox)" "$root/bin/busybox"
for module in drivers/input/evdev.ko drivers/input/misc/uinput.ko; do
  cp "$kernel"/lib/modules/*/kernel/"$module" "$root/mod"
done
cp "$built" "$root/bin/uinput"
strip "$root/bin/uinput"
for library in $(ldd "$built" | grep -o '/[^ ]*'); do
  mkdir -p "$root$(dirname "$library")"
  cp -L "$library" "$root$library"
done
cat >"$root/init" <<'INIT'
#!/bin/busybox sh
busybox=/bin/busybox
$busybox mount -t proc none /proc; $busybox mount -t sysfs none /sys; $busybox mount -t devtmpfs none /dev
$busybox insmod /mod/evdev.ko; $busybox insmod /mod/uinput.ko
$busybox mkdir -p /dev/input
/bin/uinput --test-threads=1 2>&1
echo "judged: $?"
$busybox poweroff -f
INIT
chmod +x "$root/init"
(cd "$root" && find . | cpio --quiet -o -H newc | gzip -1) >"$scratch/initrd"
# TCG: KVM is not there on most machines that run this, and the boot is short.
timeout 300 qemu-system-x86_64 -accel tcg -m 512 -nographic -no-reboot -kernel "$kernel"/boot/vmlinuz-* -initrd "$scratch/initrd" \
  -append "console=ttyS0 quiet panic=-1 rdinit=/init" </dev/null | tr -d '\r' | tee "$scratch/told" | sed -n '/^running/,$p'
grep -q '^judged: 0$' "$scratch/told"
