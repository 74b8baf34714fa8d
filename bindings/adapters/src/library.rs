//! Loading of the libraries of the vendors.

use std::error::Error as _;
use std::ffi::OsString;
use std::path::PathBuf;

use libloading::Library;

use crate::{OpenError, Vendor};

/// A loaded library.
pub(crate) struct DriverLibrary {
    vendor: Vendor,
    library: Library,
}

/// Text of the operating system, which is the source of the error.
fn error_reason(error: &libloading::Error) -> String {
    error.source().map_or_else(|| error.to_string(), ToString::to_string)
}

/// Name of the library on this system, or the path from the variable of the vendor.
pub(crate) fn library_path(vendor: Vendor, variable: Option<OsString>) -> PathBuf {
    let name = if cfg!(windows) { vendor.windows_library() } else { vendor.linux_library() };
    variable.filter(|path| !path.is_empty()).map_or_else(|| name.into(), PathBuf::from)
}

impl DriverLibrary {
    /// Loads the library of the vendor.
    pub(crate) fn load(vendor: Vendor) -> Result<Self, OpenError> {
        let path = library_path(vendor, std::env::var_os(vendor.variable()));
        let library = open(&path).map_err(|error| OpenError::NoDriver {
            vendor,
            library: path.clone(),
            reason: error_reason(&error),
        })?;
        Ok(Self { vendor, library })
    }

    /// The function `name`, whose type is `F`. It is valid until the library is closed.
    ///
    /// # Safety
    /// `F` must be a function pointer type with the signature of the function in the library of the vendor.
    pub(crate) unsafe fn function<F: Copy>(&self, name: &'static str) -> Result<F, OpenError> {
        // SAFETY: the caller guarantees the type; the name needs no NUL, `get` adds one.
        let symbol = unsafe { self.library.get::<F>(name.as_bytes()) };
        let missing = |_| OpenError::OldDriver { vendor: self.vendor, function: name };
        symbol.map(|symbol| *symbol).map_err(missing)
    }
}

#[cfg(not(windows))]
fn open(path: &std::path::Path) -> Result<Library, libloading::Error> {
    // SAFETY: the libraries of PEAK and Kvaser have no preconditions for their initialisation. The path is the name of one
    // of them, or chosen by the user, who could preload any library anyway.
    unsafe { Library::new(path) }
}

/// A bare name is searched in the folders of program and system, never in the current folder: that may be a folder of
/// captures from somebody else.
#[cfg(windows)]
fn open(path: &std::path::Path) -> Result<Library, libloading::Error> {
    use libloading::os::windows::{LOAD_LIBRARY_SEARCH_DEFAULT_DIRS, Library as WindowsLibrary};
    let is_name = path.components().count() == 1;
    let flags = if is_name { LOAD_LIBRARY_SEARCH_DEFAULT_DIRS } else { 0 };
    // SAFETY: as for other systems.
    unsafe { WindowsLibrary::load_with_flags(path, flags) }.map(Library::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_variable_overrides_the_name_of_the_library() {
        let name = if cfg!(windows) { "PCANBasic.dll" } else { "libpcanbasic.so" };
        assert_eq!(library_path(Vendor::Pcan, None), PathBuf::from(name));
        assert_eq!(library_path(Vendor::Pcan, Some(OsString::new())), PathBuf::from(name));
        assert_eq!(library_path(Vendor::Pcan, Some("/opt/x.so".into())), PathBuf::from("/opt/x.so"));
    }
}
