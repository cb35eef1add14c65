//! Controls by their raw calls, for what the `v4l` crate cannot do: it panics on control types that it does
//! not know (any newer kernel has some) and cannot read menus of integers or bitmasks.
//!
//! All `unsafe` of the camera is here: three calls that pass one plain struct to the kernel.

use ::v4l::device::Handle;
use ::v4l::v4l_sys::{v4l2_control, v4l2_query_ext_ctrl, v4l2_querymenu};
use ::v4l::v4l2::{self, vidioc};
use std::ffi::c_void;
use std::io;

/// The flag that asks for the next control after an id (`V4L2_CTRL_FLAG_NEXT_CTRL`).
const NEXT: u32 = 0x8000_0000;

/// What the driver says about a control.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ControlInfo {
    /// Number.
    pub id: u32,
    /// The driver's name for it.
    pub name: String,
    /// `V4L2_CTRL_TYPE_*`.
    pub kind: u32,
    /// Smallest value.
    pub min: i64,
    /// Largest value.
    pub max: i64,
    /// Distance between values.
    pub step: u64,
    /// Value after power-up.
    pub default: i64,
    /// `V4L2_CTRL_FLAG_*`.
    pub flags: u32,
}

/// `V4L2_CTRL_TYPE_*` that hold one number of 32 bits, or stand for an action.
const BUTTON: u32 = 4;
const MENU: u32 = 3;
const INTEGER_MENU: u32 = 9;
const PLAIN: [u32; 6] = [1, 2, MENU, BUTTON, 8, INTEGER_MENU];
const DISABLED: u32 = 0x0001;
const READ_ONLY: u32 = 0x0004;
const WRITE_ONLY: u32 = 0x0040;

impl ControlInfo {
    /// Whether it is one number that can be set.
    pub fn is_settable(&self) -> bool {
        PLAIN.contains(&self.kind) && self.flags & (DISABLED | READ_ONLY) == 0
    }

    /// Whether it can be read back.
    pub fn is_readable(&self) -> bool {
        PLAIN.contains(&self.kind) && self.kind != BUTTON && self.flags & (DISABLED | WRITE_ONLY) == 0
    }

    /// Whether its values have names.
    pub fn is_menu(&self) -> bool {
        matches!(self.kind, MENU | INTEGER_MENU)
    }
}

/// Passes `argument` to the kernel.
///
/// # Safety
/// `request` must be the call whose argument is a `T`.
unsafe fn call<T>(handle: &Handle, request: vidioc::_IOC_TYPE, argument: &mut T) -> io::Result<()> {
    // SAFETY: the caller matches request and type; the kernel writes within the struct only, which lives
    // until the call returns, and the handle keeps the descriptor open.
    unsafe { v4l2::ioctl(handle.fd(), request, std::ptr::from_mut(argument).cast::<c_void>()) }
}

/// All controls of a device.
pub fn controls(handle: &Handle) -> Vec<ControlInfo> {
    let mut found = Vec::new();
    let mut id = NEXT;
    loop {
        // SAFETY: all-zero is a valid value of this struct of numbers.
        let mut query: v4l2_query_ext_ctrl = unsafe { std::mem::zeroed() };
        query.id = id;
        // SAFETY: the argument of VIDIOC_QUERY_EXT_CTRL is this struct.
        if unsafe { call(handle, vidioc::VIDIOC_QUERY_EXT_CTRL, &mut query) }.is_err() {
            return found;
        }
        let name: Vec<u8> = query.name.iter().map(|c| *c as u8).take_while(|c| *c != 0).collect();
        found.push(ControlInfo {
            id: query.id,
            name: String::from_utf8_lossy(&name).into_owned(),
            kind: query.type_,
            min: query.minimum,
            max: query.maximum,
            step: query.step,
            default: query.default_value,
            flags: query.flags,
        });
        id = query.id | NEXT;
    }
}

/// The value of a control.
pub fn get(handle: &Handle, id: u32) -> io::Result<i64> {
    let mut control = v4l2_control { id, value: 0 };
    // SAFETY: the argument of VIDIOC_G_CTRL is this struct.
    unsafe { call(handle, vidioc::VIDIOC_G_CTRL, &mut control) }?;
    Ok(i64::from(control.value))
}

/// Sets a control; the driver may round the value, so read it back.
pub fn set(handle: &Handle, id: u32, value: i32) -> io::Result<()> {
    let mut control = v4l2_control { id, value };
    // SAFETY: the argument of VIDIOC_S_CTRL is this struct.
    unsafe { call(handle, vidioc::VIDIOC_S_CTRL, &mut control) }
}

/// The name of a menu's value; `None` for values that the driver skips.
pub fn menu_item(handle: &Handle, control: &ControlInfo, index: u32) -> Option<String> {
    // SAFETY: all-zero is a valid value of this struct of numbers.
    let mut query: v4l2_querymenu = unsafe { std::mem::zeroed() };
    (query.id, query.index) = (control.id, index);
    // SAFETY: the argument of VIDIOC_QUERYMENU is this struct.
    unsafe { call(handle, vidioc::VIDIOC_QUERYMENU, &mut query) }.ok()?;
    // SAFETY: both readings are plain bytes; which one the kernel wrote follows from the control's type.
    unsafe {
        if control.kind == INTEGER_MENU {
            return Some({ query.__bindgen_anon_1.value }.to_string());
        }
        let name: Vec<u8> = { query.__bindgen_anon_1.name }.into_iter().take_while(|c| *c != 0).collect();
        Some(String::from_utf8_lossy(&name).into_owned())
    }
}
