//! OpenImageIO through the shim in `shim.cpp`: the foreign calls, and a safe [`Input`] around them.

use std::ffi::{CStr, CString, c_char, c_void};
use std::marker::PhantomData;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::ptr::NonNull;

/// OpenImageIO's numbers for the types of samples that are read (`TypeDesc::BASETYPE`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum BaseType {
    U8 = 2,
    U16 = 4,
    U32 = 6,
    F16 = 10,
    F32 = 11,
    F64 = 12,
}

impl BaseType {
    fn from_raw(raw: i32) -> Option<Self> {
        [Self::U8, Self::U16, Self::U32, Self::F16, Self::F32, Self::F64]
            .into_iter()
            .find(|base| *base as i32 == raw)
    }
}

/// A part as OpenImageIO gives it. The same fields in the same order as `PartSpec` in shim.cpp.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct PartSpec {
    /// x, y, width, height.
    pub data: [i32; 4],
    pub display: [i32; 4],
    pub n_channels: i32,
    /// Bits a sample that the file declares; 0 where it does not.
    pub bits: i32,
    /// Neither a volume nor deep.
    pub is_flat: i32,
}

#[repr(C)]
struct RawInput {
    _opaque: [u8; 0],
}

// SAFETY: the declarations repeat those in shim.cpp.
unsafe extern "C" {
    fn shim_error() -> *const c_char;
    fn shim_configure(image_mib: i32, max_channels: i32);
    fn shim_open(path: *const c_char, format: *const c_char) -> *mut RawInput;
    fn shim_close(input: *mut RawInput);
    fn shim_part(input: *mut RawInput, part: i32, out: *mut PartSpec) -> i32;
    fn shim_part_name(input: *mut RawInput) -> *const c_char;
    fn shim_channel_name(input: *mut RawInput, channel: i32) -> *const c_char;
    fn shim_channel_type(input: *mut RawInput, channel: i32) -> i32;
    fn shim_read(input: *mut RawInput, part: i32, begin: i32, end: i32, base: i32, out: *mut c_void) -> i32;
}

/// OpenImageIO's global settings. Not `Send`, so that all inputs stay on the thread that made it: the shim keeps one
/// error message.
pub struct Oiio {
    _one_thread: PhantomData<*const ()>,
}

impl Oiio {
    /// Sets limits and threads; to be called once.
    pub fn new(image_mib: u32, max_channels: i32) -> Self {
        // SAFETY: takes numbers only.
        unsafe { shim_configure(i32::try_from(image_mib).unwrap_or(i32::MAX), max_channels) };
        Self {
            _one_thread: PhantomData,
        }
    }

    /// Opens a file with the reader called `format` and no other.
    pub fn open(&self, path: &Path, format: &CStr) -> Result<Input<'_>, String> {
        let path = CString::new(path.as_os_str().as_bytes()).map_err(|_| "its path holds a zero byte")?;
        // SAFETY: both strings end with zero and outlive the call.
        let raw = unsafe { shim_open(path.as_ptr(), format.as_ptr()) };
        NonNull::new(raw)
            .map(|raw| Input { raw, _oiio: self })
            .ok_or_else(error)
    }
}

/// An opened file.
pub struct Input<'a> {
    raw: NonNull<RawInput>,
    _oiio: &'a Oiio,
}

impl Input<'_> {
    /// Makes `part` current. OpenImageIO gives no sure way to tell a damaged part from none.
    pub fn part(&mut self, part: i32) -> Result<PartSpec, String> {
        let mut spec = PartSpec::default();
        // SAFETY: the input is open and `spec` is a `PartSpec` that may be written.
        match unsafe { shim_part(self.raw.as_ptr(), part, &mut spec) } {
            0 => Err(error()),
            _ => Ok(spec),
        }
    }

    /// Name of the current part.
    pub fn part_name(&mut self) -> String {
        // SAFETY: the string is the shim's own and is copied before the next call.
        unsafe { copied(shim_part_name(self.raw.as_ptr())) }
    }

    /// Name and type of a channel of the current part; none where its type is not read.
    pub fn channel(&mut self, channel: i32) -> (String, Option<BaseType>) {
        // SAFETY: the shim checks the index for the name, OpenImageIO for the type; the name is copied.
        unsafe {
            let name = shim_channel_name(self.raw.as_ptr(), channel);
            let base = shim_channel_type(self.raw.as_ptr(), channel);
            (
                if name.is_null() { String::new() } else { copied(name) },
                BaseType::from_raw(base),
            )
        }
    }

    /// Channels `begin..end` of a part of `n_pixels`, interleaved, as `base`, which must have the size of `T`.
    pub fn read<T: Sample>(&mut self, part: i32, begin: i32, end: i32, n_pixels: usize) -> Result<Vec<T>, String> {
        let spec = self.part(part)?;
        let same_size = i64::from(spec.data[2]) * i64::from(spec.data[3]) == n_pixels as i64;
        if spec.is_flat == 0 || !same_size || begin < 0 || begin >= end || end > spec.n_channels {
            return Err("it changed while it was read".into());
        }
        let mut samples = vec![T::default(); n_pixels * (end - begin) as usize];
        // SAFETY: OpenImageIO writes width × height × channels samples of `T::BASE`: just checked, all are there.
        let done = unsafe {
            shim_read(
                self.raw.as_ptr(),
                part,
                begin,
                end,
                T::BASE as i32,
                samples.as_mut_ptr().cast::<c_void>(),
            )
        };
        if done == 0 { Err(error()) } else { Ok(samples) }
    }
}

impl Drop for Input<'_> {
    fn drop(&mut self) {
        // SAFETY: opened by the shim, closed once.
        unsafe { shim_close(self.raw.as_ptr()) }
    }
}

/// A plain number that OpenImageIO can write.
pub trait Sample: Copy + Default {
    /// Its type there.
    const BASE: BaseType;
}

impl Sample for u8 {
    const BASE: BaseType = BaseType::U8;
}
impl Sample for u16 {
    const BASE: BaseType = BaseType::U16;
}
impl Sample for u32 {
    const BASE: BaseType = BaseType::U32;
}
impl Sample for f32 {
    const BASE: BaseType = BaseType::F32;
}

fn error() -> String {
    // SAFETY: the string is the shim's own and is copied before the next call.
    unsafe { copied(shim_error()) }
}

/// # Safety
/// `string` ends with zero and lives during the call.
unsafe fn copied(string: *const c_char) -> String {
    // SAFETY: as the caller promises.
    unsafe { CStr::from_ptr(string) }.to_string_lossy().into_owned()
}
