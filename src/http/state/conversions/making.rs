//! Makes the file of a conversion. In: the key of the stored picture and the conversion. Out: a file in the workspace,
//! for which disk space is reserved before it is written.

use std::sync::Arc;

use super::{
    conversion::{Conversion, Converted, Outcome, SliceRecipe},
    convert::{convert, most_bytes, size},
    pyramid,
};
use crate::{
    contract::{
        Code, Fault,
        artifact::{Colours, FileFormat},
    },
    disk_budget::{DiskBudget, Reserved},
    http::{ApiError, background},
    jobs::slice_view,
    store::{
        Store, StoreError,
        blobs::{LocalBlob, OpenBlob},
        failpoint::step,
        is_full,
    },
};
use pinstack_science::archive::ArchiveLimits;

/// What conversions need.
pub(super) struct Maker {
    /// The stored pictures.
    pub store: Store,
    /// Where space is reserved.
    pub disk: Arc<DiskBudget>,
    /// Limits of the zip of a slice.
    pub limits: ArchiveLimits,
}

/// What a file is made of.
enum Stored {
    File(LocalBlob, FileFormat),
    Pyramid(LocalBlob, Colours),
    /// The zip, of which one slice is read.
    Slice(OpenBlob, Arc<SliceRecipe>),
}

impl Stored {
    async fn get(store: &Store, source: &str, conversion: Conversion) -> Result<Self, Fault> {
        let picture = async || store.blobs.fetch(source, &store.workspace).await;
        let found = match conversion {
            Conversion::File(format) => picture().await.map(|found| found.map(|picture| Self::File(picture, format))),
            Conversion::Pyramid(colours) => picture().await.map(|found| found.map(|it| Self::Pyramid(it, colours))),
            Conversion::Slice(recipe) => {
                let zip = store.blobs.open(source, &store.workspace).await;
                zip.map(|found| found.map(|zip| Self::Slice(zip, recipe)))
            }
        };
        let found = found.map_err(|error| ApiError::from(error).fault().clone())?;
        found.ok_or_else(|| internal(&anyhow::anyhow!("{source} is missing")))
    }
}

impl Maker {
    /// Makes the file.
    pub(super) async fn make(&self, source: String, conversion: Conversion) -> Outcome {
        let Self { store, disk, limits } = self;
        let fault = |error: StoreError| ApiError::from(error).fault().clone();
        let full = disk_full(&conversion);
        // until it is here: afterwards the free bytes of the disk exclude it
        let copied = match store.blobs.head(&source).await.map_err(fault)? {
            Some(blob) => disk.reserve_copy(blob.size).await.map_err(fault)?.granted().map_err(|_| full.clone())?,
            None => return Err(internal(&anyhow::anyhow!("{source} is missing"))),
        };
        let stored = Arc::new(Stored::get(store, &source, conversion).await?);
        drop(copied);
        let measured = Arc::clone(&stored);
        let most = blocking(&full, move || match &*measured {
            Stored::File(picture, _) => most_bytes(picture.path()),
            Stored::Pyramid(picture, _) => {
                size(picture.path()).map(|(width, height)| pyramid::most_bytes(width, height))
            }
            Stored::Slice(_, recipe) => {
                Ok(pyramid::most_bytes(recipe.profile.image_width, recipe.profile.image_height))
            }
        })
        .await?;
        let reserved = disk.reserve(most).await.map_err(fault)?;
        let Reserved::Granted(mut space) = reserved else { return Err(full) };
        let (spool, limits) = (store.workspace.path().to_owned(), *limits);
        blocking(&full, move || {
            step("convert.make")?;
            let file = tempfile::Builder::new().prefix("converted-").tempfile_in(&spool)?;
            let length = match &*stored {
                Stored::File(picture, format) => convert(picture.path(), file.as_file(), *format)?,
                Stored::Pyramid(picture, colours) => pyramid::write(picture.path(), file.as_file(), *colours)?,
                Stored::Slice(zip, recipe) => {
                    let SliceRecipe { profile, options, slice } = &**recipe;
                    let slice = match (slice_view(zip.bytes(), profile, options, *slice, &limits), zip.failure()) {
                        (Ok(slice), _) => slice,
                        (Err(_), Some(error)) => return Ok(Err(ApiError::from(error).fault().clone())),
                        (Err(fault), None) => return Ok(Err(fault)),
                    };
                    pyramid::write_raster(slice, file.as_file(), Colours::Plain)?
                }
            };
            space.written(length);
            Ok(Ok(Arc::new(Converted { file, source, length })))
        })
        .await?
    }
}

/// `full`: the fault when the disk is full.
async fn blocking<T: Send + 'static>(
    full: &Fault,
    work: impl FnOnce() -> anyhow::Result<T> + Send + 'static,
) -> Result<T, Fault> {
    let worked = background::spawn_blocking(work).await;
    worked.map_err(|error| internal(&error.into()))?.map_err(|error| cannot(&error, full))
}

fn cannot(error: &anyhow::Error, full: &Fault) -> Fault {
    match error.chain().filter_map(|cause| cause.downcast_ref()).any(is_full) {
        true => full.clone(),
        false => internal(error),
    }
}

fn disk_full(conversion: &Conversion) -> Fault {
    let detail = match conversion {
        Conversion::File(_) => {
            "the disk of the server has no space to convert the picture; request it as it is stored (without Accept), \
             or free some space"
        }
        Conversion::Pyramid(_) | Conversion::Slice(_) => {
            "the disk of the server has no space to prepare the picture for the viewer; free some space"
        }
    };
    Fault::new(Code::InsufficientStorage, detail)
}

fn internal(error: &anyhow::Error) -> Fault {
    ApiError::internal(format!("cannot convert a picture: {error:#}")).fault().clone()
}
