//! Notes of the story.

use reqwest::StatusCode;
use serde_json::json;

use super::{Story, Told};

impl Story {
    /// Writes a note about the scan with an idempotency key, and deletes it.
    pub async fn note(&mut self, key: &str) -> Told<()> {
        let path = "/v1/scans/bee/notes";
        let written = self
            .send(|client, url| {
                client.post(format!("{url}{path}")).header("idempotency-key", key).json(&json!({ "text": "a" }))
            })
            .await?;
        assert_eq!(written.status, StatusCode::CREATED, "{}", written.json());
        let notes = self.get(path).await?.json()["items"].take();
        assert_eq!(notes, json!([written.json()]), "an acknowledged note exists once");
        let note = format!("{path}/{}", notes[0]["id"].as_str().expect("an id"));
        let deleted = self.send(|client, url| client.delete(format!("{url}{note}"))).await?;
        assert_eq!(deleted.status, StatusCode::NO_CONTENT, "{}", deleted.json());
        assert_eq!(self.get(path).await?.json()["items"], json!([]), "what was deleted does not exist");
        Ok(())
    }
}
