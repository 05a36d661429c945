# Sourced by scripts/demo and scripts/test: makes sure that there is a Rust toolchain and a Vulkan driver.
# shellcheck shell=bash

if ! command -v cargo >/dev/null 2>&1; then
  echo "Rust is not installed. Install it with rustup (https://rustup.rs), then run this again." >&2
  exit 2
fi

has_vulkan_driver() {
  local folder
  for folder in /usr/share/vulkan/icd.d /etc/vulkan/icd.d /usr/local/share/vulkan/icd.d "${HOME:-/root}/.local/share/vulkan/icd.d"; do
    if compgen -G "$folder/*.json" >/dev/null; then return 0; fi
  done
  [ -n "${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}" ] || [ "$(uname -s)" != Linux ]
}

has_vulkan_loader() {
  [ "$(uname -s)" != Linux ] || ldconfig -p 2>/dev/null | grep -q 'libvulkan\.so\.1' || compgen -G '/usr/lib/*/libvulkan.so.1' >/dev/null
}

missing=()
if ! has_vulkan_driver || ! has_vulkan_loader; then missing+=(mesa-vulkan-drivers libvulkan1); fi
if ! command -v c++ >/dev/null 2>&1; then missing+=(g++); fi # one dependency compiles C++

if [ "${#missing[@]}" -gt 0 ]; then
  as_root=()
  if [ "$(id -u)" != 0 ]; then as_root=(sudo -n); fi
  echo "Needed and not found: ${missing[*]}." >&2
  if ! { command -v apt-get >/dev/null 2>&1 && "${as_root[@]}" true 2>/dev/null; }; then
    echo "Install with:  sudo sh -c 'apt-get update && apt-get install -y ${missing[*]}'" >&2
    exit 2
  fi
  echo "Installing." >&2
  "${as_root[@]}" apt-get update -qq >/dev/null
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "${missing[@]}" >/dev/null
fi

# Mesa wants a folder of its own.
if [ -z "${XDG_RUNTIME_DIR:-}" ]; then
  XDG_RUNTIME_DIR="$(mktemp -d)"
  export XDG_RUNTIME_DIR
  trap 'rm -rf "$XDG_RUNTIME_DIR"' EXIT
fi
