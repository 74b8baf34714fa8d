//! The border to the worker: `alloc`, `call`, and two buffers that the worker reads after each call.
#![expect(unsafe_code, reason = "the border between WebAssembly and the worker consists of addresses")]

use std::cell::RefCell;
use std::io;
use std::sync::Arc;

use crate::WorkerState;
use crate::files::ContentAccess;

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Reads from a file of the user; a negative number is an error.
    fn read(file: u32, offset: f64, room: *mut u8, length: usize) -> i32;
}

/// Files that the worker reads.
struct PageFiles;

impl ContentAccess for PageFiles {
    fn read(&self, file: u32, offset: u64, room: &mut [u8]) -> io::Result<usize> {
        #[expect(clippy::cast_precision_loss, reason = "files of a browser are below 2^53 bytes")]
        let offset = offset as f64;
        // SAFETY: the worker writes at most `length` bytes from the address of `room`, which outlives the call.
        let count = unsafe { read(file, offset, room.as_mut_ptr(), room.len()) };
        usize::try_from(count).map_err(|_| io::Error::other("the browser can no longer read the file"))
    }
}

/// State between two calls.
struct Border {
    session: WorkerState,
    request: Vec<u8>,
    response: Vec<u8>,
    bytes: Vec<u8>,
}

thread_local! {
    static BORDER: RefCell<Border> = RefCell::new(Border {
        session: WorkerState::new(Arc::new(PageFiles)),
        request: Vec::new(),
        response: Vec::new(),
        bytes: Vec::new(),
    });
}

/// Room for a request of `length` bytes.
#[unsafe(no_mangle)]
pub extern "C" fn alloc(length: usize) -> *mut u8 {
    BORDER.with_borrow_mut(|border| {
        border.request.clear();
        border.request.resize(length, 0);
        border.request.as_mut_ptr()
    })
}

/// Answers the request in the room of `alloc`; returns the length of the response.
#[unsafe(no_mangle)]
pub extern "C" fn call() -> usize {
    BORDER.with_borrow_mut(|border| {
        let response = border.session.call_json(&border.request);
        border.response.clear();
        // Writing to memory does not fail.
        let _ = serde_json::to_writer(&mut border.response, &response.value);
        border.bytes = response.bytes;
        border.response.len()
    })
}

/// Address of the last response.
#[unsafe(no_mangle)]
pub extern "C" fn response() -> *const u8 {
    BORDER.with_borrow(|border| border.response.as_ptr())
}

/// Address of the bytes of the last response; their number is in it.
#[unsafe(no_mangle)]
pub extern "C" fn bytes() -> *const u8 {
    BORDER.with_borrow(|border| border.bytes.as_ptr())
}
