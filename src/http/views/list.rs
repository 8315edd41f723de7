//! Lists, one page at a time.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Calibration, Reconstruction, Stack};
use crate::{
    contract::{ProfileSummary, Scan, request::JobRequest},
    store::{Job, Page, Skipped},
};

/// Lists: the name, the item, the row that it is made of and how, and the documentation of what cannot be read.
macro_rules! lists {
    ($($(#[$doc:meta])* $name:ident: $item:ident from $row:ident by $of:path, $(#[$skipped:meta])*;)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Serialize, Deserialize, ToSchema)]
        pub struct $name {
            /// At most `limit` items; fewer when the response would exceed about 4 MiB.
            pub items: Vec<$item>,
            /// Pass it as `cursor` to get the next page; null on the last page.
            pub next_cursor: Option<String>,
            $(#[$skipped])*
            #[serde(default, skip_serializing_if = "Vec::is_empty")]
            pub skipped: Vec<Skipped>,
        }

        impl From<Page<$row>> for $name {
            fn from(Page { items, next_cursor, skipped }: Page<$row>) -> Self {
                Self { items: items.into_iter().filter_map($of).collect(), next_cursor, skipped }
            }
        }
    )*};
}

lists! {
    /// A page of profiles, newest first.
    ProfileList: ProfileSummary from ProfileSummary by Some,
    /// Revisions that cannot be read and are omitted from `items`; absent when there are none.
    ;
    /// A page of scans, newest first.
    ScanList: Scan from Scan by Some,
    /// Scans that cannot be read and are omitted from `items`; absent when there are none.
    ;
    /// A page of stacks, newest first.
    StackList: Stack from Job by stack,
    /// Stacks that cannot be read and are omitted from `items`; absent when there are none.
    ;
    /// A page of calibrations, newest first.
    CalibrationList: Calibration from Job by calibration,
    /// Calibrations that cannot be read and are omitted from `items`; absent when there are none.
    ;
    /// A page of reconstructions, newest first.
    ReconstructionList: Reconstruction from Job by reconstruction,
    /// Reconstructions that cannot be read and are omitted from `items`; absent when there are none.
    ;
}

fn stack(job: Job) -> Option<Stack> {
    match &job.request {
        JobRequest::Stack(request) => Some(Stack::of(&job, request)),
        JobRequest::Calibration(_) | JobRequest::Reconstruction(_) => None,
    }
}

fn calibration(job: Job) -> Option<Calibration> {
    match &job.request {
        JobRequest::Calibration(request) => Some(Calibration::of(&job, request)),
        JobRequest::Stack(_) | JobRequest::Reconstruction(_) => None,
    }
}

fn reconstruction(job: Job) -> Option<Reconstruction> {
    match &job.request {
        JobRequest::Reconstruction(request) => Some(Reconstruction::of(&job, request)),
        JobRequest::Stack(_) | JobRequest::Calibration(_) => None,
    }
}
