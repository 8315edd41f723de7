//! Where the bucket is, as the settings say it.

use std::{fmt, path::PathBuf, str::FromStr};

use anyhow::{Context, bail};
use serde::{Deserialize, Serialize};

use crate::store::blobs::require_key;

/// The bucket and how to reach it.
#[derive(Debug, Clone)]
pub struct S3Location {
    /// Bucket and prefix.
    pub url: S3Url,
    /// URL of the server; `None`: that of AWS for the region.
    pub endpoint: Option<String>,
    /// Region of the bucket; `None`: that of the environment (`AWS_REGION`), or `us-east-1`.
    pub region: Option<String>,
    /// PEM file with certificates that are trusted besides the public ones.
    pub ca_file: Option<PathBuf>,
    /// File with the key, in the format of `~/.aws/credentials`; `None`: from the environment or the machine.
    pub credentials_file: Option<PathBuf>,
}

/// A URL `s3://bucket` or `s3://bucket/prefix`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct S3Url(String);

impl S3Url {
    /// Wraps a URL; [`S3Url::parts`] tells whether it is one.
    pub fn new(url: impl Into<String>) -> Self {
        Self(url.into())
    }

    /// True for a URL of a bucket. Says nothing about whether the bucket exists.
    pub fn is_valid(&self) -> bool {
        self.parts().is_ok()
    }

    /// Name of the bucket, and the prefix without a `/` at its end.
    ///
    /// # Errors
    /// When it is not such a URL.
    pub fn parts(&self) -> anyhow::Result<(&str, &str)> {
        let form = "storage_url must look like s3://bucket or s3://bucket/prefix";
        let rest = self.0.strip_prefix("s3://").context(form)?.trim_end_matches('/');
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let is_name = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b"-.".contains(&b);
        if !(3..=63).contains(&bucket.len()) || !bucket.bytes().all(is_name) {
            bail!("{form}; the name of a bucket has 3 to 63 characters of a-z 0-9 . -");
        }
        if !prefix.is_empty() {
            require_key(prefix).map_err(|_| {
                anyhow::anyhow!("{form}; a prefix has A-Z a-z 0-9 . _ - in its parts, which do not begin with a dot")
            })?;
        }
        Ok((bucket, prefix))
    }
}

impl fmt::Display for S3Url {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.trim_end_matches('/'))
    }
}

impl FromStr for S3Url {
    type Err = std::convert::Infallible;

    fn from_str(url: &str) -> Result<Self, Self::Err> {
        Ok(Self::new(url))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_url_has_a_bucket_and_perhaps_a_prefix() {
        for (url, bucket, prefix) in [
            ("s3://lab", "lab", ""),
            ("s3://lab/", "lab", ""),
            ("s3://lab.scans-2/rig_1/macro/", "lab.scans-2", "rig_1/macro"),
        ] {
            assert_eq!(S3Url::new(url).parts().expect(url), (bucket, prefix), "{url}");
        }
    }

    #[test]
    fn what_is_no_url_of_a_bucket_is_refused() {
        for url in
            ["", "lab", "https://lab", "s3://", "s3://La", "s3://lab/../x", "s3://lab//x", "s3://lab/.x", "s3://l"]
        {
            assert!(!S3Url::new(url).is_valid(), "{url}");
        }
    }
}
