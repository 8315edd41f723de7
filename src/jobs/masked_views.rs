//! The views of an unpacked bundle, from which a visual hull is made: cameras, and the files of masks and images.

use std::{
    fs,
    path::{Component, Path, PathBuf},
};

use pinstack_science::{
    hull::ViewPictures,
    imaging::{
        Plane, Raster,
        codec::{self, ImageFault, Limits},
    },
    types::{Error, error::ErrorKind, pinhole::PinholeCamera},
};

/// The views that have a mask.
#[derive(Debug)]
pub struct MaskedViews {
    folder: PathBuf,
    masks: Vec<PathBuf>,
    /// Names of their images, which may contain folders.
    pub names: Vec<String>,
    /// Their cameras.
    pub cameras: Vec<PinholeCamera>,
    /// Names of the images that have no mask.
    pub without_mask: Vec<String>,
}

impl MaskedViews {
    /// Finds the masks in a folder with `images/` and `masks/`: `masks/NAME.png` as COLMAP has them, or without the
    /// extension of the image.
    ///
    /// # Errors
    /// [`ErrorKind::InvalidPoses`] for the name of an image that is not within `images/`.
    pub fn of(folder: &Path, views: Vec<(String, PinholeCamera)>) -> Result<Self, Error> {
        let (masks, names, cameras, without_mask) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut found = Self { folder: folder.to_owned(), masks, names, cameras, without_mask };
        for (name, camera) in views {
            if !Path::new(&name).components().all(|part| matches!(part, Component::Normal(_))) {
                let detail = format!("the image '{name}' is not within images/; use the names that COLMAP gave");
                return Err(Error::new(ErrorKind::InvalidPoses, detail));
            }
            let plain = Path::new(&name).with_extension("png");
            let masks = [folder.join(format!("masks/{name}.png")), folder.join("masks").join(plain)];
            match masks.into_iter().find(|mask| mask.is_file()) {
                Some(mask) => {
                    found.masks.push(mask);
                    found.names.push(name);
                    found.cameras.push(camera);
                }
                None => found.without_mask.push(name),
            }
        }
        Ok(found)
    }
}

impl ViewPictures for MaskedViews {
    fn mask(&self, view: usize) -> Result<Plane<u8>, Error> {
        Ok(decoded(&self.masks[view], codec::decode)?.luma().map(|alpha| alpha.round() as u8))
    }

    fn picture(&self, view: usize) -> Result<Option<Raster>, Error> {
        let path = self.folder.join("images").join(&self.names[view]);
        // fused images are transparent where the mask has no object
        if path.is_file() { decoded(&path, codec::decode_rgba).map(Some) } else { Ok(None) }
    }
}

fn decoded(path: &Path, decode: fn(&[u8], &Limits) -> Result<Raster, ImageFault>) -> Result<Raster, Error> {
    let failed = |kind, what: String| Error::new(kind, format!("{}: {what}", path.display()));
    let bytes = fs::read(path).map_err(|error| failed(ErrorKind::Io, error.to_string()))?;
    decode(&bytes, &Limits::default()).map_err(|fault| failed(ErrorKind::InvalidImage, fault.to_string()))
}
