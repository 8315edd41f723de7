//! Errors of the disk under a zip.

use std::{
    io,
    sync::atomic::{AtomicBool, Ordering},
};

use super::*;

/// A disk that fails with EIO while the flag is set.
struct FailingDisk {
    bytes: Vec<u8>,
    fails: AtomicBool,
}

impl ReadAt for FailingDisk {
    fn length(&self) -> io::Result<u64> {
        self.bytes.length()
    }

    fn read_at(&self, buffer: &mut [u8], at: u64) -> io::Result<usize> {
        if self.fails.load(Ordering::SeqCst) {
            return Err(io::Error::from_raw_os_error(5));
        }
        self.bytes.read_at(buffer, at)
    }
}

#[test]
fn an_error_of_the_disk_is_not_blamed_on_the_zip() {
    let limits = ArchiveLimits::default();
    let bytes = zip(&pictures(&["a.png", "b.png"]));
    let disk = Arc::new(FailingDisk { bytes, fails: AtomicBool::new(false) });
    let open = || open_shared(disk.clone(), &limits);
    let archive = open().unwrap();
    disk.fails.store(true, Ordering::SeqCst);
    for fault in [open().err().unwrap(), archive.front().load(0).unwrap_err(), archive.front_bytes(0).unwrap_err()] {
        assert_eq!(fault.kind, ErrorKind::ResourcesExhausted, "{fault:?}");
        assert!(fault.detail.contains("no fault of the archive"), "{fault:?}");
    }
    disk.fails.store(false, Ordering::SeqCst);
    assert!(archive.front().load(0).is_ok(), "the slice is readable again with the disk");
    let folder = open_path(std::path::Path::new("/")).err().unwrap();
    assert_eq!(folder.kind, ErrorKind::ResourcesExhausted, "{folder:?}");
}

fn open_path(path: &std::path::Path) -> Result<StackArchive, Error> {
    super::open(path, &ArchiveLimits::default())
}
