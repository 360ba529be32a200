# shellcheck shell=bash
# Sourced by first-light and run-tests: what the machine must have before a build can render.
#
#   prepare_machine yes    finds what is missing and installs it (Debian's apt-get)
#   prepare_machine no     only says what is missing
#
# Wanted are a C linker (`cc`) and a Vulkan adapter: the loader library and at least one driver
# manifest. Where there is no GPU the native renderer makes the frames; Mesa's software driver (lavapipe)
# lets the tests run the shaders. Nothing here ends the caller except a missing Rust toolchain.

# Mesa's Vulkan driver complains on standard error where this is unset, and uses it for nothing here.
export XDG_RUNTIME_DIR="${XDG_RUNTIME_DIR:-${TMPDIR:-/tmp}}"

say() { printf '%s\n' "$*" >&2; }

# Finds cargo, also right after an installation that this shell's PATH does not know yet.
require_cargo() {
    command -v cargo >/dev/null 2>&1 && return 0
    if [ -x "${CARGO_HOME:-$HOME/.cargo}/bin/cargo" ]; then
        PATH="${CARGO_HOME:-$HOME/.cargo}/bin:$PATH"
        export PATH
        return 0
    fi
    say "cargo was not found. RETINA needs a Rust toolchain: see https://rustup.rs"
    return 1
}

have_linker() { command -v cc >/dev/null 2>&1; }

# The loader, libvulkan.so.1, which the renderer opens when it starts.
have_vulkan_loader() {
    local ldconfig directory IFS=:
    for directory in ${LD_LIBRARY_PATH:-}; do
        [ -n "$directory" ] && [ -e "$directory/libvulkan.so.1" ] && return 0
    done
    # An ordinary user's PATH has no sbin.
    for ldconfig in ldconfig /sbin/ldconfig /usr/sbin/ldconfig; do
        # Read in full: a reader that stops early would end ldconfig with SIGPIPE under pipefail.
        "$ldconfig" -p 2>/dev/null | grep -F 'libvulkan.so.1 ' >/dev/null && return 0
    done
    return 1
}

# Drivers named by the environment replace the loader's own search.
drivers_named() { printf '%s' "${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}"; }

# Driver manifests that the loader would read, one a line. A GPU's own driver puts its manifest
# into the same folders.
vulkan_drivers() {
    local place manifest named IFS=:
    named=$(drivers_named)
    if [ -n "$named" ]; then
        # shellcheck disable=SC2086 # a list with colons, parted on purpose
        set -- $named
    else
        set --
        for place in "${XDG_CONFIG_HOME:-$HOME/.config}" ${XDG_CONFIG_DIRS:-/etc/xdg} /usr/local/etc /etc \
            "${XDG_DATA_HOME:-$HOME/.local/share}" ${XDG_DATA_DIRS:-/usr/local/share:/usr/share}; do
            set -- "$@" "$place/vulkan/icd.d"
        done
        # shellcheck disable=SC2086 # a list with colons, parted on purpose
        set -- "$@" ${VK_ADD_DRIVER_FILES:-}
    fi
    for place in "$@"; do
        if [ -d "$place" ]; then
            for manifest in "$place"/*.json; do
                [ -f "$manifest" ] && printf '%s\n' "$manifest"
            done
        elif [ -f "$place" ]; then
            printf '%s\n' "$place"
        fi
    done
    return 0
}

# The Debian packages that are missing, as words on one line.
missing_packages() {
    local packages=""
    have_linker || packages="gcc libc6-dev"
    if [ "$(uname -s)" = Linux ]; then
        have_vulkan_loader || packages="$packages libvulkan1"
        # Where the environment names the drivers, another one would not be read.
        [ -n "$(drivers_named)" ] || [ -n "$(vulkan_drivers)" ] || packages="$packages mesa-vulkan-drivers"
    fi
    printf '%s' "${packages# }"
}

# One line for each thing found or missing.
describe_machine() {
    local drivers names
    have_linker || say "Missing: a C linker (cc); the build needs one."
    if [ "$(uname -s)" != Linux ]; then
        return 0 # elsewhere the renderer uses the system's own graphics interface
    fi
    drivers=$(vulkan_drivers)
    have_vulkan_loader || say "Missing: the Vulkan loader (libvulkan.so.1)."
    if [ -n "$drivers" ]; then
        names=$(printf '%s\n' "$drivers" | sed 's|.*/||; s|\.json$||' | sort -u | paste -s -d ' ' -)
        ! have_vulkan_loader || say "Vulkan drivers installed: $names"
    elif [ -n "$(drivers_named)" ]; then
        say "Missing: a Vulkan driver. VK_DRIVER_FILES or VK_ICD_FILENAMES names '$(drivers_named)', where none is."
    else
        say "Missing: a Vulkan driver."
    fi
}

# Installs the packages given; says what it does before it does it. 0 when apt-get did.
install_packages() {
    local -a apt=(env DEBIAN_FRONTEND=noninteractive apt-get -q
        -o Acquire::Retries=2 -o Acquire::http::Timeout=30 -o DPkg::Lock::Timeout=120)
    local by=""
    if ! command -v apt-get >/dev/null 2>&1; then
        say "There is no apt-get here. Install what these Debian packages hold in this system's own way: $*"
        return 1
    fi
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null 2>&1; then
            say "Neither root nor sudo. To install it later, as root: apt-get install $*"
            return 1
        fi
        by=" through sudo"
        # -n where nobody is there to type a password.
        if [ -t 0 ]; then apt=(sudo "${apt[@]}"); else apt=(sudo -n "${apt[@]}"); fi
    fi
    say "Installing with apt-get$by: $*"
    "${apt[@]}" update </dev/null >&2 || say "apt-get update failed; trying with the package lists that are there."
    if ! "${apt[@]}" install -y --no-install-recommends "$@" </dev/null >&2; then
        say "apt-get could not install $*; see its message above. Going on without."
        return 1
    fi
}

prepare_machine() {
    local install=$1 packages
    require_cargo || exit 2
    packages=$(missing_packages)
    describe_machine
    if [ -n "$packages" ]; then
        if [ "$install" = yes ]; then
            # shellcheck disable=SC2086 # a list of words
            ! install_packages $packages || describe_machine
        else
            say "Not installed, as asked. On Debian: apt-get install $packages"
        fi
    fi
    if [ "$(uname -s)" = Linux ] && { ! have_vulkan_loader || [ -z "$(vulkan_drivers)" ]; }; then
        say "No Vulkan adapter: rendering falls back to the CPU, which is slower."
    fi
    have_linker || say "Without a C linker the build will fail at its first link."
}
