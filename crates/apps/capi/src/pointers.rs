//! Pointers of C. Whoever makes such a value promises what the header says: texts end with zero, a pointer to a result is
//! writable, and a buffer has as many elements as its count. NULL and misaligned pointers are errors.

use crate::status::{Failure, Status};
use std::ffi::{CStr, CString, c_char};
use std::mem::MaybeUninit;
use std::ptr::NonNull;

/// A text, or NULL.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Text(*const c_char);

/// The place of a result.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Out<T>(*mut T);

/// A structure, or NULL.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct In<T>(*const T);

/// The first element of a list or of a buffer.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Elements<T>(*mut T);

/// A structure that begins with its size, of which a caller with an older header knows only the beginning. All bits zero are
/// a value of it.
///
/// # Safety
/// The structure is `repr(C)`, its first field is its size as `usize`, and zeros are valid for all fields.
pub(crate) unsafe trait Versioned: Copy {}

fn null(name: &str) -> Failure {
    Failure::new(Status::Argument, name, "is NULL", "pass a valid pointer")
}

fn misaligned(name: &str) -> Failure {
    Failure::new(Status::Argument, name, "is not aligned", "pass a pointer to a value of its type")
}

impl Text {
    /// # Safety
    /// NULL, or a text that ends with zero and that nobody changes during the call.
    pub(crate) unsafe fn of(text: *const c_char) -> Self {
        Self(text)
    }

    /// The text; `None` if it is NULL.
    pub(crate) fn get(&self, name: &str) -> Result<Option<&str>, Failure> {
        if self.0.is_null() {
            return Ok(None);
        }
        // SAFETY: the caller passes a text that ends with zero, and keeps it during the call.
        let text = unsafe { CStr::from_ptr(self.0) };
        let invalid = |_| Failure::new(Status::Argument, name, "is not UTF-8", "pass a text in UTF-8");
        text.to_str().map(Some).map_err(invalid)
    }

    /// The text.
    pub(crate) fn required(&self, name: &str) -> Result<&str, Failure> {
        self.get(name)?.ok_or_else(|| null(name))
    }
}

impl<T> Out<T> {
    /// # Safety
    /// NULL, or a place that may be written during the call.
    pub(crate) unsafe fn of(place: *mut T) -> Self {
        Self(place)
    }

    /// Checks the place before the work, so that its result is not lost.
    pub(crate) fn check(&self, name: &str) -> Result<(), Failure> {
        match NonNull::new(self.0) {
            None => Err(null(name)),
            Some(place) if !place.is_aligned() => Err(misaligned(name)),
            Some(_) => Ok(()),
        }
    }

    /// Writes the result.
    pub(crate) fn set(&self, name: &str, value: T) -> Result<(), Failure> {
        self.check(name)?;
        // SAFETY: the place is not NULL and aligned, and the caller may write to it.
        unsafe { self.0.write(value) };
        Ok(())
    }
}

impl Out<*mut c_char> {
    /// Writes a new text, which [`close_text`] frees.
    pub(crate) fn set_text(&self, name: &str, text: &str) -> Result<(), Failure> {
        self.check(name)?;
        self.set(name, c_text(text).into_raw())
    }
}

/// Frees a text of [`Out::set_text`].
pub(crate) fn close_text(text: Out<c_char>) {
    if !text.0.is_null() {
        // SAFETY: the caller passes a text that this library made, once.
        drop(unsafe { CString::from_raw(text.0) });
    }
}

/// A text for C. Zero bytes inside become U+FFFD.
pub(crate) fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default()
}

impl<T: Versioned> In<T> {
    /// # Safety
    /// NULL, or a structure that begins with the number of its bytes.
    pub(crate) unsafe fn of(structure: *const T) -> Self {
        Self(structure)
    }

    /// The structure: zeros if it is NULL, and for the fields that a smaller structure does not have.
    pub(crate) fn get(&self, name: &str) -> Result<T, Failure> {
        let mut value = MaybeUninit::<T>::zeroed();
        if !self.0.is_null() {
            let size = size_at(self.0.cast(), size_of::<T>(), name)?;
            // SAFETY: the caller's structure has `size` bytes, no more than the value, which it does not overlap.
            unsafe { self.0.cast::<u8>().copy_to_nonoverlapping(value.as_mut_ptr().cast(), size) };
        }
        // SAFETY: zeros, and what C programs write, are valid for all fields of a versioned structure.
        Ok(unsafe { value.assume_init() })
    }
}

impl<T: Versioned> Out<T> {
    /// Writes as many bytes of the structure as the caller knows. Its size stays.
    pub(crate) fn set_versioned(&self, name: &str, value: T) -> Result<(), Failure> {
        self.check(name)?;
        let size = size_at(self.0.cast_const().cast(), size_of::<T>(), name)?;
        let head = size_of::<usize>();
        // SAFETY: the caller's structure has `size` bytes, at least those of the size and at most those of the value.
        unsafe {
            (&raw const value)
                .cast::<u8>()
                .add(head)
                .copy_to_nonoverlapping(self.0.cast::<u8>().add(head), size - head);
        }
        Ok(())
    }
}

/// The size that a structure begins with.
fn size_at(structure: *const usize, full: usize, name: &str) -> Result<usize, Failure> {
    if !structure.is_aligned() {
        return Err(misaligned(name));
    }
    // SAFETY: the caller passes a structure, which begins with its size; the pointer is aligned and not NULL.
    let size = unsafe { structure.read() };
    // The structures are aligned to pointers, so that the size of every version is a multiple of theirs.
    if (size_of::<usize>()..=full).contains(&size) && size % size_of::<usize>() == 0 {
        return Ok(size);
    }
    let problem = format!("its struct_size is {size}, and the library knows {full} bytes");
    Err(Failure::new(
        Status::Abi,
        name,
        problem,
        "initialise it by the function of the header, of this library's version",
    ))
}

impl<T> Elements<T> {
    /// # Safety
    /// NULL, or the first of as many elements as the caller says.
    pub(crate) unsafe fn of(first: *mut T) -> Self {
        Self(first)
    }

    /// Is it NULL?
    pub(crate) fn is_null(&self) -> bool {
        self.0.is_null()
    }

    fn checked(&self, name: &str, count: usize) -> Result<NonNull<T>, Failure> {
        let first = NonNull::new(self.0).ok_or_else(|| null(name))?;
        if !first.is_aligned() {
            return Err(misaligned(name));
        }
        if count.checked_mul(size_of::<T>()).is_none_or(|bytes| bytes > isize::MAX as usize) {
            return Err(Failure::new(
                Status::Argument,
                "count",
                format!("{count} is out of range"),
                "pass its elements",
            ));
        }
        Ok(first)
    }

    /// Checks a buffer before the work, so that its result is not lost.
    pub(crate) fn check(&self, count: usize) -> Result<(), Failure> {
        self.checked("buffer", count).map(|_| ())
    }

    /// Elements to read.
    pub(crate) fn read(&self, name: &str, count: usize) -> Result<Vec<T>, Failure>
    where
        T: Copy,
    {
        if count == 0 {
            return Ok(Vec::new());
        }
        let first = self.checked(name, count)?;
        // SAFETY: the list is not NULL and aligned, and has `count` elements, which nobody changes during the call.
        Ok(unsafe { std::slice::from_raw_parts(first.as_ptr().cast_const(), count) }.to_vec())
    }

    /// Copies rows to a buffer of `count` elements.
    pub(crate) fn write_rows(
        &self,
        (count, row_stride): (usize, usize),
        values: &[T],
        row: usize,
    ) -> Result<(), Failure>
    where
        T: Copy,
    {
        let stride = if row_stride == 0 { row } else { row_stride };
        let rows = values.len().checked_div(row).unwrap_or(0);
        if stride < row {
            let problem = format!("{stride} is less than the {row} elements of a row");
            return Err(Failure::new(Status::Argument, "row_stride", problem, "pass 0 for rows without a gap"));
        }
        let needed = rows.checked_sub(1).map_or(Some(0), |gaps| gaps.checked_mul(stride)?.checked_add(row));
        if needed.is_none_or(|needed| count < needed) {
            let needed = needed.map_or_else(|| "more".into(), |n| n.to_string());
            let problem = format!("{count} elements are fewer than the {needed} that are written");
            return Err(Failure::new(Status::Argument, "count", problem, "pass a larger buffer and its count"));
        }
        if rows == 0 {
            return Ok(());
        }
        let first = self.checked("buffer", count)?;
        for (y, from) in values.chunks_exact(row).enumerate() {
            // SAFETY: row `y` ends within the `count` elements of the buffer, which the caller lends; it does not overlap
            // our own values.
            unsafe { first.add(y * stride).as_ptr().copy_from_nonoverlapping(from.as_ptr(), row) };
        }
        Ok(())
    }
}
