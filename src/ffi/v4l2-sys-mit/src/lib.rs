//! The V4L2 types that the `v4l` crate uses, generated once and kept.
//!
//! The published crate of this name runs bindgen at each build, which needs libclang on the builder's
//! machine. The workspace patches it with this one: same name, same version, no build script.
//! How `bindings.rs` was made: `generate.sh` beside this crate's manifest, from Linux 6.1's
//! `linux/videodev2.h`. It holds only what `v4l` 0.14 and nokhwa's Linux backend name, and serves any
//! 64-bit little-endian Linux: x86_64 and aarch64 agree in the offset of every field.

#![allow(clippy::all, missing_docs, non_camel_case_types, non_snake_case, non_upper_case_globals, dead_code)]

include!("bindings.rs");

// An ioctl's number contains the size of its argument, so a wrong size is a call that the kernel does not
// know. These are the sizes of the kernel's 64-bit ABI.
const _: () = {
    use std::mem::size_of;
    assert!(size_of::<v4l2_capability>() == 104);
    assert!(size_of::<v4l2_fmtdesc>() == 64);
    assert!(size_of::<v4l2_format>() == 208);
    assert!(size_of::<v4l2_requestbuffers>() == 20);
    assert!(size_of::<v4l2_buffer>() == 88);
    assert!(size_of::<v4l2_streamparm>() == 204);
    assert!(size_of::<v4l2_querymenu>() == 44);
    assert!(size_of::<v4l2_query_ext_ctrl>() == 232);
    assert!(size_of::<v4l2_ext_control>() == 20);
    assert!(size_of::<v4l2_ext_controls>() == 32);
    assert!(size_of::<v4l2_frmsizeenum>() == 44);
    assert!(size_of::<v4l2_frmivalenum>() == 52);
};
