//! The metadata of result images as exiftool reads it.

use std::process::Command;

use serde_json::Value;

use crate::{
    run,
    server::{Server, small_rig, write_slices},
};

/// The tags of a file; numbers are numbers.
pub fn tags(file: &std::path::Path) -> Value {
    let text = run(Command::new("exiftool").args(["-json", "-n", "-G0"]).arg(file));
    serde_json::from_str::<Value>(&text).expect("exiftool writes JSON")[0].take()
}

#[test]
#[ignore = "needs curl, zip, exiftool"]
fn every_format_keeps_the_camera_of_the_reference_slice() {
    let server = Server::start();
    let slices = server.folder.path().join("view");
    write_slices(&slices);
    // Tagged as cameras do, and wrongly in what must be corrected.
    run(Command::new("sh").current_dir(&slices).args([
        "-c",
        "exiftool -q -overwrite_original -Make=Canon -Model='Canon EOS 5DS' -FocalLength=65 -FNumber=8 -ISO=100 -ExposureTime=1/60 \
         -DateTimeOriginal='2026:01:02 03:04:05' -SerialNumber=123456 -LensModel='MP-E65mm' -ExifImageWidth=9 -ExifImageHeight=9 front/*.jpg && zip -q -r stack.zip front back",
    ]));
    server.put_profile(&small_rig());
    let stack = server.fuse(&slices.join("stack.zip"), "");
    assert_eq!(stack["state"], "succeeded", "{stack}");
    let image = format!("/v1/stacks/{}/image", stack["id"].as_str().expect("an id"));
    let files =
        [("Accept: image/png", "image.png"), ("Accept: image/tiff", "image.tif"), ("Accept: image/jpeg", "image.jpg")];
    for (accept, name) in files {
        let file = server.folder.path().join(name);
        server.download(&["-H", accept], &image, &file);
        let tags = tags(&file);
        assert_eq!(tags["EXIF:Make"], "Canon", "{name}: {tags}");
        assert_eq!(tags["EXIF:Model"], "Canon EOS 5DS", "{name}: {tags}");
        assert!(tags["EXIF:FocalLength"].is_null(), "the engraved one is not the principal distance: {tags}");
        let software = tags["EXIF:Software"].as_str().unwrap_or_default();
        assert!(software.starts_with("pinstack ") && stack["software"] == software, "{name}: {tags}");
        assert_eq!(tags["EXIF:ISO"], 100, "{name}: {tags}");
        assert_eq!(tags["EXIF:DateTimeOriginal"], "2026:01:02 03:04:05", "{name}: {tags}");
        assert_eq!(tags["EXIF:ExifImageWidth"], 240, "{name}: {tags}");
        assert_eq!(tags["EXIF:ExifImageHeight"], 160, "{name}: {tags}");
        assert_eq!(tags["EXIF:Orientation"], 1, "{name}: {tags}");
    }
}
