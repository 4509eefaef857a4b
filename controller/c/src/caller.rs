//! What a caller in C gives, checked as far as it can be (null pointers, alignment, lengths, texts), and how a call that is refused or
//! panics ends.
#![allow(unsafe_code)]

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::fmt::{self, Display, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::slice;

use crate::types::OwResult;

/// Why a call was not done.
pub(crate) type Refused = (OwResult, String);

thread_local! {
    pub(crate) static MESSAGE: RefCell<CString> = RefCell::default();
}

/// Runs `call`, catches its panics and notes why it was refused. Nothing allocates when all is well.
pub(crate) fn guarded(call: impl FnOnce() -> Result<(), Refused>) -> OwResult {
    let panicked = |_| Err((OwResult::Internal, "the controller panicked".to_owned()));
    match catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(panicked) {
        Ok(()) => OwResult::Ok,
        Err((result, text)) => {
            // Without zeros a text always is a C string.
            let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
            MESSAGE.set(text);
            result
        }
    }
}

pub(crate) fn argument(text: &str) -> Refused {
    (OwResult::Argument, text.to_owned())
}

/// Refuses what no pointer to `len` values can be. A length may be what a function that failed gave: -1 as a `size_t`.
pub(crate) fn check<T>(pointer: *const T, len: usize, name: &str) -> Result<(), Refused> {
    if pointer.is_null() {
        Err(argument(&format!("{name} is null")))
    } else if !pointer.is_aligned() {
        Err(argument(&format!("{name} is not aligned")))
    } else if len > isize::MAX as usize / size_of::<T>() {
        Err(argument(&format!("{name} cannot have a length of {len}")))
    } else {
        Ok(())
    }
}

/// # Safety
/// `pointer` is null or points to a `T` that nobody else changes.
pub(crate) unsafe fn given<'a, T>(pointer: *const T, name: &str) -> Result<&'a T, Refused> {
    check(pointer, 1, name)?;
    // SAFETY: as promised by the caller.
    Ok(unsafe { &*pointer })
}

/// # Safety
/// `pointer` is null or points to a `T` that nobody else uses.
pub(crate) unsafe fn given_mut<'a, T>(pointer: *mut T, name: &str) -> Result<&'a mut T, Refused> {
    check(pointer, 1, name)?;
    // SAFETY: as promised by the caller.
    Ok(unsafe { &mut *pointer })
}

/// # Safety
/// `pointer` is null or points to `len` values that nobody else changes.
pub(crate) unsafe fn array<'a, T>(pointer: *const T, len: usize, name: &str) -> Result<&'a [T], Refused> {
    check(pointer, len, name)?;
    // SAFETY: as promised by the caller.
    Ok(unsafe { slice::from_raw_parts(pointer, len) })
}

/// # Safety
/// `pointer` is null or points to `len` places that nobody else uses.
pub(crate) unsafe fn array_mut<'a, T>(pointer: *mut T, len: usize, name: &str) -> Result<&'a mut [T], Refused> {
    check(pointer, len, name)?;
    // SAFETY: as promised by the caller.
    Ok(unsafe { slice::from_raw_parts_mut(pointer, len) })
}

/// # Safety
/// `pointer` is null or a C string.
pub(crate) unsafe fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Refused> {
    if pointer.is_null() {
        return Err(argument(&format!("{name} is null")));
    }
    // SAFETY: as promised by the caller.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| argument(&format!("{name} is not UTF-8")))
}

/// # Safety
/// `names` is null or points to `count` pointers, each null or a C string.
pub(crate) unsafe fn texts<'a>(names: *const *const c_char, count: usize) -> Result<Vec<&'a str>, Refused> {
    // SAFETY: as promised by the caller.
    let names = unsafe { array(names, count, "names")? };
    // SAFETY: as promised by the caller.
    names.iter().map(|&name| unsafe { text(name, "a name") }).collect()
}

/// # Safety
/// `buffer` is null or points to `size` bytes that nobody else uses.
pub(crate) unsafe fn put(text: impl Display, buffer: *mut c_char, size: usize) -> Result<(), Refused> {
    if size == 0 {
        return Err(argument("buffer has no room"));
    }
    // SAFETY: as promised by the caller.
    let place = unsafe { array_mut(buffer, size, "buffer")? };
    let mut room = Room { place, used: 0 };
    // It takes what fits.
    let _ = write!(room, "{text}");
    room.place[room.used] = 0;
    Ok(())
}

/// A caller's buffer, which keeps a place for the zero at the end.
struct Room<'a> {
    place: &'a mut [c_char],
    used: usize,
}

impl Write for Room<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let free = self.place.len() - 1 - self.used;
        for byte in text.bytes().take(free) {
            self.place[self.used] = byte as c_char;
            self.used += 1;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_a_result() {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(|_| {}));
        let result = guarded(|| panic!("a mistake"));
        std::panic::set_hook(before);
        assert_eq!(result, OwResult::Internal);
        MESSAGE.with_borrow(|text| assert_eq!(text.to_str(), Ok("the controller panicked")));
    }
}
