//! From a scan to the request of a reconstruction: which pictures, with what is known of their camera and their angles.

use sha2::{Digest, Sha256};

use crate::{
    contract::{
        Name, Scan,
        outcome::Artifact,
        reconstruction::{ReconstructionOptions, ReconstructionRequest, ReconstructionView, StoredPicture},
        request::Upload,
    },
    http::{
        ApiResult, App,
        auth::Caller,
        scans::{
            bundle::{Ready, described, ready, require_one_camera},
            find,
            table::views,
        },
        views::ScanWithViews,
    },
    store::digest::hex,
};
use pinstack_science::types::metrics::Severity;

/// Most remarks that are kept of a view.
const MOST_REMARKS: usize = 3;

/// The request of a reconstruction of the present views of a scan.
///
/// # Errors
/// `scan_not_found`; `not_found` when no view has a result; `not_finished`; `scan_mismatch`.
pub async fn request_of(
    app: &App,
    caller: &Caller,
    name: &Name,
    options: ReconstructionOptions,
) -> ApiResult<(Scan, ReconstructionRequest)> {
    let scan = find(app, caller, name).await?;
    let views = views(app, caller, name).await?;
    let ready = ready(name, &views, options.partial)?;
    require_one_camera(name, &ready)?;
    let table = ScanWithViews::tabulated(scan.clone(), views.clone()).await?;
    let described = described(&scan, &ready);
    let pictured: Vec<ReconstructionView> = ready
        .iter()
        .zip(&described.views)
        .map(|(ready, bundled)| ReconstructionView {
            name: bundled.stem.clone(),
            stack: ready.view.stack.id,
            extension: bundled.extension.clone(),
            bit_depth: bundled.bit_depth,
            angles: bundled.angles,
            image: picture(ready.image),
            mask: ready.result.mask.as_ref().map(picture),
            remarks: remarks(ready, &table),
        })
        .collect();
    let expected = scan.input.expected_views.unwrap_or_else(|| u32::try_from(views.len()).unwrap_or(u32::MAX));
    let mut request = ReconstructionRequest {
        scan: name.clone(),
        options,
        upload: Upload { key: String::new(), bytes: 0, sha256: String::new(), filename: None },
        expected,
        image_size_px: [described.width, described.height],
        intrinsics: described.intrinsics,
        canvas_centre_px: described.canvas_centre_px,
        radius_mm: described.radius_mm,
        pan_is_clockwise: described.pan_is_clockwise,
        views: pictured,
    };
    request.upload = all_pictures(&request);
    Ok((scan, request))
}

fn picture(artifact: &Artifact) -> StoredPicture {
    let Artifact { key, bytes, sha256, .. } = artifact.clone();
    StoredPicture { key, bytes, sha256 }
}

/// What is conspicuous about the stack of a view: how it differs from its neighbours, and warnings of its metrics.
fn remarks(ready: &Ready<'_>, table: &ScanWithViews) -> Vec<String> {
    let row = table.views.iter().find(|row| row.name == ready.view.stem);
    let outliers = row.into_iter().flat_map(|row| row.outliers.iter().map(|outlier| outlier.detail.clone()));
    let findings = ready.result.metrics.findings.iter().filter(|finding| finding.severity == Severity::Warning);
    outliers.chain(findings.map(|finding| finding.detail.clone())).take(MOST_REMARKS).collect()
}

/// Size and digest of all pictures, by their paths and digests.
fn all_pictures(request: &ReconstructionRequest) -> Upload {
    let (mut bytes, mut digest) = (0_u64, Sha256::new());
    for (path, picture) in request.pictures() {
        bytes = bytes.saturating_add(picture.bytes);
        digest.update(format!("{path} {}\n", picture.sha256));
    }
    Upload { key: String::new(), bytes, sha256: hex(&digest.finalize()), filename: None }
}
