# For scripts that pack a program into an image without a distribution.

# with_libraries PROGRAM DIR: what PROGRAM loads, if it isn't static, to the same paths below DIR.
with_libraries() {
    local program=$1 root=$2 libraries library
    libraries=$(ldd "$program" 2>/dev/null) || return 0
    # Paths only: what the kernel provides has none.
    for library in $(grep -o '/[^ ]*' <<<"$libraries"); do
        install -D -m 0755 "$library" "$root$library"
    done
}
