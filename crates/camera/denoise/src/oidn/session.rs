//! One device and its filters: they are created, run and released in order, and errors are values.

#![allow(unsafe_code, reason = "pointers to images, lent to a library in C for as long as its filter runs")]

use super::library::{Functions, RawDevice, RawFilter, known_version};
use crate::denoiser::{DenoiseError, Triples};
use std::ffi::{CStr, c_char, c_int, c_void};
use std::marker::PhantomData;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;

/// The library's number of the format with three floats per pixel.
const FLOAT3: c_int = 3;
/// The library's error number for "cancelled by the progress monitor".
const CANCELLED: c_int = 6;

/// A device on the CPU. The library's device is released on drop.
pub(super) struct Device<'a> {
    functions: &'a Functions,
    raw: RawDevice,
}

impl<'a> Device<'a> {
    /// A device with this number of threads. They are not pinned to cores, since pinned ones would compete with ours.
    pub(super) fn new(functions: &'a Functions, threads: usize) -> Result<Self, DenoiseError> {
        let device = Self { functions, raw: functions.new_cpu_device() };
        if device.raw.is_null() {
            let said = device.error().map_or_else(|e| e.to_string(), |()| "no reason given".into());
            return Err(DenoiseError::Library(format!("Open Image Denoise has no device on this CPU: {said}")));
        }
        let threads = c_int::try_from(threads).unwrap_or(0);
        // SAFETY: the device is from this library, alive, and used by this thread alone.
        unsafe {
            (functions.set_device_int)(device.raw, c"numThreads".as_ptr(), threads);
            (functions.set_device_bool)(device.raw, c"setAffinity".as_ptr(), false);
            (functions.commit_device)(device.raw);
        }
        device.error()?;
        Ok(device)
    }

    /// The library's version as text.
    pub(super) fn version(&self) -> Result<String, DenoiseError> {
        // SAFETY: the device is alive.
        let number = unsafe { (self.functions.get_device_int)(self.raw, c"version".as_ptr()) };
        self.error()?;
        known_version(number).map_err(DenoiseError::Unavailable)
    }

    /// A filter for ray-traced images.
    pub(super) fn filter(&self) -> Result<Filter<'_>, DenoiseError> {
        // SAFETY: the device is alive, and outlives the filter, which borrows it.
        let raw = unsafe { (self.functions.new_filter)(self.raw, c"RT".as_ptr()) };
        let filter = Filter { device: self, raw, images: PhantomData };
        self.error()?;
        if raw.is_null() {
            return Err(DenoiseError::Library("Open Image Denoise gives no filter, and no reason".into()));
        }
        Ok(filter)
    }

    /// The error since the last call, if there is one.
    fn error(&self) -> Result<(), DenoiseError> {
        let mut message: *const c_char = ptr::null();
        // SAFETY: the device is alive, or null, which selects the error of this thread. The message pointer is valid
        // for writes.
        let code = unsafe { (self.functions.get_device_error)(self.raw, &raw mut message) };
        if code == 0 {
            return Ok(());
        }
        if code == CANCELLED {
            return Err(DenoiseError::Cancelled);
        }
        let text = if message.is_null() {
            format!("error {code}")
        } else {
            // SAFETY: the library returns a string that ends in zero and lives until the next call on this device.
            unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned()
        };
        Err(DenoiseError::Library(format!("Open Image Denoise: {text}")))
    }
}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        if !self.raw.is_null() {
            // SAFETY: the device is alive and is released once. Its filters borrow it and are gone.
            unsafe { (self.functions.release_device)(self.raw) };
        }
    }
}

/// A filter. The library's filter is released on drop. It borrows its images, which must stay at their place until it
/// has run.
pub(super) struct Filter<'a> {
    device: &'a Device<'a>,
    raw: RawFilter,
    images: PhantomData<&'a mut Triples>,
}

impl<'a> Filter<'a> {
    /// Sets an input image.
    pub(super) fn input(&mut self, name: &CStr, image: &'a Triples) {
        // The library takes one pointer type for input and output. It writes to the output alone.
        self.image(name, image.data().as_ptr().cast_mut().cast(), image.width(), image.height());
    }

    /// Sets the output image.
    pub(super) fn output(&mut self, image: &'a mut Triples) {
        let (width, height) = (image.width(), image.height());
        self.image(c"output", image.data_mut().as_mut_ptr().cast(), width, height);
    }

    fn image(&mut self, name: &CStr, data: *mut c_void, width: u32, height: u32) {
        let set = self.device.functions.set_shared_image;
        // SAFETY: the filter is alive. A plane holds width * height triples without gaps, which matches strides of
        // zero. It is borrowed for as long as the filter lives.
        unsafe { set(self.raw, name.as_ptr(), data, FLOAT3, width as usize, height as usize, 0, 0, 0) };
    }

    /// Sets a boolean parameter.
    pub(super) fn set_bool(&mut self, name: &CStr, value: bool) {
        // SAFETY: the filter is alive.
        unsafe { (self.device.functions.set_filter_bool)(self.raw, name.as_ptr(), value) };
    }

    /// Sets a numeric parameter.
    pub(super) fn set_float(&mut self, name: &CStr, value: f32) {
        // SAFETY: the filter is alive.
        unsafe { (self.device.functions.set_filter_float)(self.raw, name.as_ptr(), value) };
    }

    /// Runs the filter. `progress` gets the finished fraction and returns whether to continue. Any thread may call it.
    pub(super) fn run(self, progress: &(dyn Fn(f64) -> bool + Sync)) -> Result<(), DenoiseError> {
        extern "C" fn monitor(user: *mut c_void, fraction: f64) -> bool {
            // SAFETY: `user` is the address of `progress` below, which outlives the filter's run. Any thread may call
            // it, because it is `Sync`.
            let progress = unsafe { &*user.cast::<&(dyn Fn(f64) -> bool + Sync)>() };
            // A panic must not unwind into C. It ends the run instead.
            catch_unwind(AssertUnwindSafe(|| progress(fraction))).unwrap_or(false)
        }
        let functions = self.device.functions;
        let user = (&raw const progress).cast_mut().cast();
        // SAFETY: the filter is alive and borrows its images. `user` lives until this function returns, which drops the
        // filter.
        unsafe {
            (functions.set_monitor)(self.raw, Some(monitor), user);
            (functions.commit_filter)(self.raw);
        }
        self.device.error()?;
        // SAFETY: as above. The call returns when all threads of the library are done.
        unsafe { (functions.execute_filter)(self.raw) };
        self.device.error()
    }
}

impl Drop for Filter<'_> {
    fn drop(&mut self) {
        if !self.raw.is_null() {
            // SAFETY: the filter is alive and is released once. The device outlives it.
            unsafe { (self.device.functions.release_filter)(self.raw) };
        }
    }
}
