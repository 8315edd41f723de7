//! Pictures and documents into the files of a job: written into the scratch folder, hashed, named as artifacts.

use crate::contract::JobError;
use std::{
    fs::File,
    io::{self, BufWriter, Read, Seek, SeekFrom, Write},
};

use serde::Serialize;
use sha2::{Digest, Sha256};

use super::{Bench, MadeFile, Watcher};
use crate::{
    contract::{
        Code, Fault,
        options::{ImageFormat, StackOptions},
        outcome::Artifact,
    },
    store::{blobs::result_key, digest::hex, failpoint::step},
};
use pinstack_science::imaging::{
    Raster,
    codec::{Metadata, encode_png, encode_tiff, write_jpeg},
};

/// How a picture is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Png,
    Tiff,
    /// Of this quality, 1 to 100, without alpha.
    Jpeg {
        quality: u8,
    },
}

impl Encoding {
    /// What `options` ask for.
    pub(super) fn of(options: &StackOptions) -> Self {
        match options.format {
            ImageFormat::Png => Self::Png,
            ImageFormat::Tiff => Self::Tiff,
            ImageFormat::Jpeg => Self::Jpeg { quality: options.jpeg_quality },
        }
    }
}

/// Writes the artifacts of one job.
pub(super) struct Press<'a> {
    bench: &'a Bench,
    watcher: &'a dyn Watcher,
}

/// An artifact and the file that holds it.
pub(super) type Pressed = (Artifact, MadeFile);

impl<'a> Press<'a> {
    pub(super) fn new(bench: &'a Bench, watcher: &'a dyn Watcher) -> Self {
        Self { bench, watcher }
    }

    pub(super) fn png(&self, name: &str, picture: &Raster, metadata: &Metadata) -> Result<Pressed, JobError> {
        self.picture(name, Encoding::Png, picture, metadata)
    }

    /// Writes `picture` as artifact `name`. Stops in the middle when the job is no longer wanted.
    pub(super) fn picture(
        &self,
        name: &str,
        encoding: Encoding,
        picture: &Raster,
        metadata: &Metadata,
    ) -> Result<Pressed, JobError> {
        match encoding {
            Encoding::Png => self.file(name, "png", "image/png", |out| encode_png(out, picture, metadata)),
            Encoding::Tiff => self.file(name, "tif", "image/tiff", |out| encode_tiff(out, picture, metadata)),
            Encoding::Jpeg { quality } => {
                self.file(name, "jpg", "image/jpeg", |out| write_jpeg(out, picture, metadata, quality))
            }
        }
    }

    /// Writes `value` as artifact `name`, a JSON document.
    pub(super) fn json(&self, name: &str, value: &impl Serialize) -> Result<Pressed, JobError> {
        self.file(name, "json", "application/json", |out| Ok(serde_json::to_writer(out, value)?))
    }

    fn file(
        &self,
        name: &str,
        extension: &str,
        media_type: &str,
        fill: impl FnOnce(&mut Out<'_>) -> io::Result<()>,
    ) -> Result<Pressed, JobError> {
        self.watcher.check()?;
        let file_name = format!("{name}.{extension}");
        let path = self.bench.scratch.join(&file_name);
        let written = self.write(&path, fill);
        let (bytes, sha256) = written.map_err(|error| self.stop(&error))?;
        let key = result_key(self.bench.job.id, self.bench.job.lease_token, &file_name);
        let artifact =
            Artifact { name: name.to_owned(), key: key.clone(), media_type: media_type.to_owned(), bytes, sha256 };
        Ok((artifact, MadeFile { path, key }))
    }

    fn write(
        &self,
        path: &std::path::Path,
        fill: impl FnOnce(&mut Out<'_>) -> io::Result<()>,
    ) -> io::Result<(u64, String)> {
        step("artifact.make")?;
        let file = File::options().create_new(true).read(true).write(true).open(path)?;
        let mut out = BufWriter::with_capacity(1 << 20, Watched { file, watcher: self.watcher });
        fill(&mut out)?;
        let mut written = out.into_inner().map_err(io::IntoInnerError::into_error)?;
        // hashed afterwards: a TIFF is not written from front to back
        written.file.seek(SeekFrom::Start(0))?;
        let mut hash = Sha256::new();
        let mut bytes = 0;
        let mut block = vec![0; 1 << 20];
        loop {
            let read = written.read(&mut block)?;
            if read == 0 {
                return Ok((bytes, hex(&hash.finalize())));
            }
            hash.update(block.get(..read).unwrap_or_default());
            bytes += read as u64;
        }
    }

    fn stop(&self, error: &io::Error) -> JobError {
        if let Err(cancelled) = self.watcher.check() {
            return cancelled.into();
        }
        match error.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                let detail = "the disk of the service is full, so the results could not be written; make room and send \
                              the stack again";
                Fault::new(Code::InsufficientStorage, detail).into()
            }
            _ => {
                tracing::error!(job = %self.bench.job.id, ?error, "cannot write an artifact");
                let detail = "the service could not write the results; its log has the details under the job's id";
                Fault::new(Code::Unavailable, detail).into()
            }
        }
    }
}

/// What an artifact is written through.
type Out<'a> = BufWriter<Watched<'a>>;

/// A file that refuses to go on once the job is no longer wanted.
struct Watched<'a> {
    file: File,
    watcher: &'a dyn Watcher,
}

impl Watched<'_> {
    fn check(&self) -> io::Result<()> {
        self.watcher.check().map_err(io::Error::other)
    }
}

impl Write for Watched<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.check()?;
        step("artifact.write")?;
        self.file.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Read for Watched<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.check()?;
        self.file.read(bytes)
    }
}

impl Seek for Watched<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}
