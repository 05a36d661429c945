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

if ! has_vulkan_driver || ! has_vulkan_loader; then
  command_line="apt-get update && apt-get install -y mesa-vulkan-drivers libvulkan1"
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
    echo "No Vulkan driver found: installing Mesa's." >&2
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq mesa-vulkan-drivers libvulkan1; } >/dev/null
  else
    echo "No Vulkan driver found. Install one with:  sudo sh -c '$command_line'" >&2
    exit 2
  fi
fi

# Mesa wants a folder of its own.
if [ -z "${XDG_RUNTIME_DIR:-}" ]; then
  XDG_RUNTIME_DIR="$(mktemp -d)"
  export XDG_RUNTIME_DIR
  trap 'rm -rf "$XDG_RUNTIME_DIR"' EXIT
fi
