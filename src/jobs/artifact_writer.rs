//! Writes the artifacts of a job: encodes a picture or document into the scratch folder, hashes the file, and describes
//! it.

use std::{
    fs::File,
    io::{self, BufWriter, Read, Seek, SeekFrom, Write},
};

use serde::Serialize;

use super::{JobContext, OutputFile, ProgressSink};
use crate::{
    contract::{
        Code, Fault, JobError,
        artifact::FileFormat,
        options::{ImageFormat, StackOptions},
        outcome::Artifact,
    },
    store::{
        blobs::result_key,
        digest::{FileDigests, digests_of},
        failpoint::step,
        is_full,
    },
};
use pinstack_science::imaging::{
    Raster,
    codec::{Metadata, encode_png, encode_tiff, write_jpeg},
};

/// File format of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Png,
    Tiff,
    /// Without alpha; quality 1 to 100.
    Jpeg {
        quality: u8,
    },
}

impl Encoding {
    /// The format that `options` request.
    pub(super) fn of(options: &StackOptions) -> Self {
        match options.format {
            ImageFormat::Png => Self::Png,
            ImageFormat::Tiff => Self::Tiff,
            ImageFormat::Jpeg => Self::Jpeg { quality: options.jpeg_quality },
        }
    }
}

/// Writes the artifacts of one job into its scratch folder.
pub(super) struct ArtifactWriter<'a> {
    context: &'a JobContext,
    sink: &'a dyn ProgressSink,
}

/// An artifact and the file that holds it.
pub(super) type WrittenArtifact = (Artifact, OutputFile);

impl<'a> ArtifactWriter<'a> {
    pub(super) fn new(context: &'a JobContext, sink: &'a dyn ProgressSink) -> Self {
        Self { context, sink }
    }

    pub(super) fn png(&self, name: &str, picture: &Raster, metadata: &Metadata) -> Result<WrittenArtifact, JobError> {
        self.picture(name, Encoding::Png, picture, metadata)
    }

    /// Writes `picture` as artifact `name`.
    ///
    /// # Errors
    /// [`JobError::Cancelled`], also in the middle of the file; a fault when the file cannot be written.
    pub(super) fn picture(
        &self,
        name: &str,
        encoding: Encoding,
        picture: &Raster,
        metadata: &Metadata,
    ) -> Result<WrittenArtifact, JobError> {
        match encoding {
            Encoding::Png => self.file(name, FileFormat::Png, |out| encode_png(out, picture, metadata)),
            Encoding::Tiff => self.file(name, FileFormat::Tiff, |out| encode_tiff(out, picture, metadata)),
            Encoding::Jpeg { quality } => {
                self.file(name, FileFormat::Jpeg, |out| write_jpeg(out, picture, metadata, quality))
            }
        }
    }

    /// Writes `value` as artifact `name`, a JSON document. Errors as [`Self::picture`].
    pub(super) fn json(&self, name: &str, value: &impl Serialize) -> Result<WrittenArtifact, JobError> {
        self.file(name, FileFormat::Json, |out| Ok(serde_json::to_writer(out, value)?))
    }

    /// Writes what `fill` writes as artifact `name`. Errors as [`Self::picture`].
    pub(super) fn file(
        &self,
        name: &str,
        format: FileFormat,
        fill: impl FnOnce(&mut Out<'_>) -> io::Result<()>,
    ) -> Result<WrittenArtifact, JobError> {
        self.sink.check()?;
        let file_name = format!("{}.{}", name.replace('/', "_"), format.extension());
        let path = self.context.scratch.join(&file_name);
        let written = self.write(&path, fill);
        let FileDigests { bytes, sha256, crc32 } = written.map_err(|error| self.failure(&error))?;
        let key = result_key(self.context.job.id, self.context.job.lease_token, &file_name);
        let media_type = format.media_type().to_owned();
        let artifact =
            Artifact { name: name.to_owned(), key: key.clone(), media_type, bytes, sha256, crc32: Some(crc32) };
        Ok((artifact, OutputFile { path, key }))
    }

    fn write(
        &self,
        path: &std::path::Path,
        fill: impl FnOnce(&mut Out<'_>) -> io::Result<()>,
    ) -> io::Result<FileDigests> {
        step("artifact.make")?;
        let file = File::options().create_new(true).read(true).write(true).open(path)?;
        let mut out = BufWriter::with_capacity(1 << 20, Cancellable { file, sink: self.sink });
        fill(&mut out)?;
        let mut written = out.into_inner().map_err(io::IntoInnerError::into_error)?;
        // hashed afterwards, because the TIFF encoder seeks back
        written.file.seek(SeekFrom::Start(0))?;
        digests_of(written)
    }

    fn failure(&self, error: &io::Error) -> JobError {
        if let Err(cancelled) = self.sink.check() {
            return cancelled.into();
        }
        if is_full(error) {
            let detail = "the disk of the service is full, so the results could not be written; free some disk space and \
                          send the zip again";
            return Fault::new(Code::InsufficientStorage, detail).into();
        }
        tracing::error!(?error, "cannot write an artifact");
        let detail = "the service could not write the results; its log has the cause under the id of the job";
        Fault::new(Code::Unavailable, detail).into()
    }
}

/// The buffered, cancellable file of an artifact.
pub(super) type Out<'a> = BufWriter<Cancellable<'a>>;

/// A file whose reads and writes fail once the job is cancelled.
pub(super) struct Cancellable<'a> {
    file: File,
    sink: &'a dyn ProgressSink,
}

impl Cancellable<'_> {
    fn check(&self) -> io::Result<()> {
        self.sink.check().map_err(io::Error::other)
    }
}

impl Write for Cancellable<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.check()?;
        step("artifact.write")?;
        self.file.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Read for Cancellable<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.check()?;
        self.file.read(bytes)
    }
}

impl Seek for Cancellable<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}
