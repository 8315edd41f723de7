//! Resumable uploads of a client: of a stack, of a scan, and of what is no zip.

use base64::{Engine, prelude::BASE64_STANDARD};
use reqwest::{Client, Method, RequestBuilder, StatusCode};

use super::{Story, Told};
use crate::input::scan_zip;

impl Story {
    /// Creates a resumable upload of the scan: its path.
    pub async fn begin_scan(&mut self) -> Told<String> {
        let metadata = format!("purpose {},scan {}", BASE64_STANDARD.encode("scan"), BASE64_STANDARD.encode("bee"));
        let begun = self
            .send(|client, url| {
                let creation = Self::tus(client, Method::POST, &format!("{url}/v1/uploads"));
                creation.header("upload-length", scan_zip().len()).header("upload-metadata", metadata)
            })
            .await?;
        assert_eq!(begun.status, StatusCode::CREATED, "{}", begun.json());
        Ok(begun.header("location").to_owned())
    }

    /// Sends the rest of an upload of the scan: true once it has become the stacks.
    pub async fn rest_of_scan(&mut self, path: &str) -> Told<bool> {
        let (at, scan) = self.offset(path).await?;
        if scan.is_some() {
            return Ok(true);
        }
        let bytes = scan_zip().split_off(at);
        let sent = self
            .send(|client, url| {
                let piece = Self::tus(client, Method::PATCH, &format!("{url}{path}")).header("upload-offset", at);
                piece.header("content-type", "application/offset+octet-stream").body(bytes)
            })
            .await?;
        assert_eq!(sent.status, StatusCode::NO_CONTENT, "{}", sent.json());
        Ok(sent.header("pinstack-job") == "/v1/scans/bee")
    }

    /// A resumable upload that is not a zip: it is refused, and remains refused.
    pub async fn garbage(&mut self) -> Told<()> {
        let length = self.zip.len();
        let path = self.begin_upload().await?;
        let sent = self
            .send(|client, url| {
                let piece = Self::tus(client, Method::PATCH, &format!("{url}{path}")).header("upload-offset", 0);
                piece.header("content-type", "application/offset+octet-stream").body(vec![0; length])
            })
            .await?;
        assert_eq!(sent.json()["code"], "invalid_archive", "{}", sent.json());
        assert_eq!(self.get(&path).await?.json()["state"], "refused");
        Ok(())
    }

    fn tus(client: &Client, method: Method, url: &str) -> RequestBuilder {
        client.request(method, url).header("tus-resumable", "1.0.0")
    }

    /// Creates a resumable upload: its path.
    pub async fn begin_upload(&mut self) -> Told<String> {
        let metadata = format!("rig {},lens {}", BASE64_STANDARD.encode("rig"), BASE64_STANDARD.encode("lens"));
        let length = self.zip.len();
        let begun = self
            .send(|client, url| {
                let creation = Self::tus(client, Method::POST, &format!("{url}/v1/uploads"));
                creation.header("upload-length", length).header("upload-metadata", metadata)
            })
            .await?;
        assert_eq!(begun.status, StatusCode::CREATED, "{}", begun.json());
        Ok(begun.header("location").to_owned())
    }

    /// The offset of an upload, and its job once it has one.
    async fn offset(&mut self, path: &str) -> Told<(usize, Option<String>)> {
        let head = self.send(|client, url| Self::tus(client, Method::HEAD, &format!("{url}{path}"))).await?;
        assert_eq!(head.status, StatusCode::OK, "an acknowledged upload exists");
        let job = head.header("pinstack-job");
        Ok((head.header("upload-offset").parse().expect("a number"), (!job.is_empty()).then(|| job.to_owned())))
    }

    /// Sends the piece from the offset of the upload, which must not be before `told`, to `to`. Returns the job, if
    /// any.
    pub async fn piece(&mut self, path: &str, told: &mut usize, to: usize) -> Told<Option<String>> {
        let (at, job) = self.offset(path).await?;
        assert!((*told..=self.zip.len()).contains(&at), "{told} bytes were acknowledged, now there are {at}");
        *told = at;
        if at >= to || job.is_some() {
            return Ok(job);
        }
        let bytes = self.zip[at..to].to_vec();
        let sent = self
            .send(|client, url| {
                let piece = Self::tus(client, Method::PATCH, &format!("{url}{path}")).header("upload-offset", at);
                piece.header("content-type", "application/offset+octet-stream").body(bytes)
            })
            .await?;
        assert_eq!(sent.status, StatusCode::NO_CONTENT, "{}", sent.json());
        *told = sent.header("upload-offset").parse().expect("a number");
        assert_eq!(*told, to);
        let job = sent.header("pinstack-job");
        Ok((!job.is_empty()).then(|| job.to_owned()))
    }

    /// Bytes of the whole upload.
    pub fn length(&self) -> usize {
        self.zip.len()
    }
}
