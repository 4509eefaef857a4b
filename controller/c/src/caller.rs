//! What a caller in C gives, checked as far as it can be (null pointers, lengths, texts), and how a call that is refused or
//! panics ends.
#![allow(unsafe_code)]

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
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

/// # Safety
/// `pointer` is null or points to a `T` that nobody else changes.
pub(crate) unsafe fn given<'a, T>(pointer: *const T, name: &str) -> Result<&'a T, Refused> {
    // SAFETY: as promised by the caller.
    unsafe { pointer.as_ref() }.ok_or_else(|| argument(&format!("{name} is null")))
}

/// # Safety
/// `pointer` is null or points to a `T` that nobody else uses.
pub(crate) unsafe fn given_mut<'a, T>(pointer: *mut T, name: &str) -> Result<&'a mut T, Refused> {
    // SAFETY: as promised by the caller.
    unsafe { pointer.as_mut() }.ok_or_else(|| argument(&format!("{name} is null")))
}

/// # Safety
/// `pointer` is null or points to `len` values that nobody else changes.
pub(crate) unsafe fn array<'a, T>(pointer: *const T, len: usize, name: &str) -> Result<&'a [T], Refused> {
    if pointer.is_null() {
        return Err(argument(&format!("{name} is null")));
    }
    // SAFETY: as promised by the caller.
    Ok(unsafe { slice::from_raw_parts(pointer, len) })
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
pub(crate) unsafe fn put(text: &str, buffer: *mut c_char, size: usize) -> Result<(), Refused> {
    if buffer.is_null() || size == 0 {
        return Err(argument("buffer has no room"));
    }
    // SAFETY: as promised by the caller.
    let place = unsafe { slice::from_raw_parts_mut(buffer, size) };
    let bytes = text.bytes().take(size - 1).chain([0]);
    place.iter_mut().zip(bytes).for_each(|(to, byte)| *to = byte as c_char);
    Ok(())
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
