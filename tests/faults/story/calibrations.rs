//! Calibrations of the story.

use reqwest::{Client, StatusCode};
use serde_json::Value;

use super::{Story, Told};

impl Story {
    /// Calibrates by a zip with `query`, or by stored stacks that JSON names: the path of the calibration.
    pub async fn calibrate(&mut self, query: &str, body: Vec<u8>) -> Told<String> {
        let path = format!("/v1/profiles/rig/lens/calibrations{query}");
        let kind = if body.starts_with(b"{") { "application/json" } else { "application/zip" };
        let sent = |client: &Client, url: &str| {
            client.post(format!("{url}{path}")).header("content-type", kind).body(body.clone())
        };
        let posted = self.send(sent).await?;
        assert_eq!(posted.status, StatusCode::ACCEPTED, "{}", posted.json());
        Ok(posted.header("location").to_owned())
    }

    /// The revisions of the profile.
    pub async fn revisions(&mut self) -> Told<Value> {
        Ok(self.get("/v1/profiles/rig/lens/revisions").await?.json()["items"].take())
    }
}
