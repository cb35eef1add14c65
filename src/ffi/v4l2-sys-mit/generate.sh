#!/usr/bin/env bash
# Writes src/bindings.rs anew from this machine's <linux/videodev2.h>. Not part of any build: run it by hand when
# the `v4l` crate asks for a type that is missing, and commit the result.
#
# Needs `bindgen` (cargo install bindgen-cli; written with 0.73) and a libclang, e.g. that of the Python wheel:
#   python3 -m venv venv && venv/bin/pip install libclang==18.1.1
#   LIBCLANG_PATH=$(echo venv/lib/python3*/site-packages/clang/native) ./generate.sh
set -euo pipefail
cd "$(dirname "$0")"

# What `v4l` 0.14 names in its sources, and the control ids that nokhwa's Linux backend names.
types='audio|audioout|buffer|capability|captureparm|control|crop|cropcap|edid|enc_idx|encoder_cmd|exportbuffer'
types+='|ext_control|ext_controls|fmtdesc|format|fract|framebuffer|frequency|frmivalenum|frmivaltypes|frmsizeenum'
types+='|frmsizetypes|input|jpegcompression|modulator|output|outputparm|pix_format|query_ext_ctrl|queryctrl|querymenu'
types+='|requestbuffers|sliced_vbi_cap|standard|std_id|streamparm|tuner'
controls='BACKLIGHT_COMPENSATION|BRIGHTNESS|CONTRAST|EXPOSURE|FOCUS_RELATIVE|GAIN|GAMMA|HUE|IRIS_RELATIVE'
controls+='|PAN_RELATIVE|SATURATION|SHARPNESS|TILT_RELATIVE|WHITE_BALANCE_TEMPERATURE|ZOOM_RELATIVE'

work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
echo '#include <linux/videodev2.h>' > "$work/wrapper.h"
# The compiler's own headers (stddef.h) are not in the wheel, and a 64-bit ARM target looks for a stub file of glibc.
mkdir "$work/gnu"; : > "$work/gnu/stubs-32.h"
headers=$(ls -d /usr/lib/gcc/*/*/include | tail -1)

bindings() { # target, further options of bindgen
    local target=$1; shift
    bindgen "$work/wrapper.h" "$@" \
        --allowlist-type "v4l2_($types)|timeval|time_t" \
        --allowlist-var "V4L2_CTRL_FLAG_NEXT_(CTRL|COMPOUND)|V4L2_CID_($controls)" \
        --opaque-type 'v4l2_ctrl_.*' --no-doc-comments --rust-edition 2018 --rust-target 1.77 \
        -- --target="$target" -I"$work" -I"$headers" -I"/usr/include/$(uname -m)-linux-gnu"
}

# Sizes, alignments and offsets of every field must agree on both, or one file could not serve both.
bindings x86_64-unknown-linux-gnu > "$work/x86_64.rs"
bindings aarch64-unknown-linux-gnu > "$work/aarch64.rs"
cmp "$work/x86_64.rs" "$work/aarch64.rs"
bindings x86_64-unknown-linux-gnu --no-layout-tests > src/bindings.rs
echo "src/bindings.rs: $(wc -l < src/bindings.rs) lines, x86_64 and aarch64 agree in every offset"
