//! Warped slices between the two passes, in a file that nobody else sees.

use std::{fs::File, io, os::unix::fs::FileExt, path::Path};

use crate::{
    imaging::{Rect, Sample},
    model::{Code, Fault},
};

/// An unnamed file with room for all warped slices, one after the other, rows of interleaved samples. It is
/// gone when this is dropped, and also when the process dies.
#[derive(Debug)]
pub(super) struct Scratch {
    file: File,
    width: usize,
    height: usize,
    channels: usize,
}

impl Scratch {
    /// A file for slices of `width` x `height` px with `channels` samples in `folder`.
    pub fn create(folder: &Path, width: usize, height: usize, channels: usize) -> Result<Self, Fault> {
        let file = tempfile::tempfile_in(folder).map_err(|error| fault("make", &error))?;
        Ok(Self { file, width, height, channels })
    }

    /// Writes slice `index`, whole.
    pub fn write<S: Sample>(&self, index: usize, samples: &[S]) -> Result<(), Fault> {
        const CHUNK: usize = 1 << 20;
        let mut bytes = Vec::with_capacity(CHUNK * S::BYTES);
        let mut at = self.start::<S>(index, 0, 0);
        for chunk in samples.chunks(CHUNK) {
            bytes.clear();
            S::to_bytes(chunk, &mut bytes);
            self.file.write_all_at(&bytes, at).map_err(|error| fault("write", &error))?;
            at += bytes.len() as u64;
        }
        Ok(())
    }

    /// Reads the pixels of `rect` of slice `index` into `samples`, row by row. `bytes` is a buffer.
    pub fn read<S: Sample>(
        &self,
        index: usize,
        rect: Rect,
        samples: &mut Vec<S>,
        bytes: &mut Vec<u8>,
    ) -> Result<(), Fault> {
        let row = rect.width * self.channels;
        samples.resize(row * rect.height, S::default());
        bytes.resize(row * S::BYTES, 0);
        for (y, out) in samples.chunks_exact_mut(row.max(1)).enumerate() {
            let at = self.start::<S>(index, rect.x, rect.y + y);
            self.file.read_exact_at(bytes, at).map_err(|error| fault("read", &error))?;
            S::from_bytes(bytes, out);
        }
        Ok(())
    }

    fn start<S: Sample>(&self, index: usize, x: usize, y: usize) -> u64 {
        let pixel = (index * self.height + y) * self.width + x;
        (pixel * self.channels * S::BYTES) as u64
    }
}

fn fault(verb: &str, error: &io::Error) -> Fault {
    let full = matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded);
    let (code, advice) = match full {
        true => (Code::InsufficientStorage, "make room on the server's disk and run the stack again"),
        false => (Code::Internal, "look at the server's data folder"),
    };
    Fault::new(code, format!("cannot {verb} the scratch file of the fusion ({error}); {advice}"))
}
