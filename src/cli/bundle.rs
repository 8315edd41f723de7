//! `pinstack bundle`: the bundle of a scan, from the data folder.

use std::{io::Write, path::PathBuf};

use anyhow::{Context, anyhow};
use clap::Args;
use futures::StreamExt;

use super::{output::say, store::Place};
use crate::{
    contract::Name,
    http::{App, Policy, auth::Caller, scans::bundle},
};
use pinstack_science::photogrammetry::bundle::Layout;

/// Write the bundle of a scan for a reconstruction program; a server may run meanwhile
#[derive(Debug, Args)]
pub struct Bundle {
    #[command(flatten)]
    place: Place,
    /// Name of the scan
    scan: String,
    /// The program that the bundle is for: colmap, meshroom, metashape, realitycapture, odm, openmvg or nerfstudio
    #[arg(long, value_name = "PROGRAM", value_parser = layout)]
    layout: Layout,
    /// Leave out views that have no result
    #[arg(long)]
    partial: bool,
    /// File to write; must not exist [default: {scan}_{layout}.zip]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

fn layout(text: &str) -> Result<Layout, String> {
    let known = || Layout::ALL.map(Layout::name).join(", ");
    Layout::ALL.into_iter().find(|layout| layout.name() == text).ok_or_else(|| format!("choose one of {}", known()))
}

impl Bundle {
    /// Runs the command.
    ///
    /// # Errors
    /// What `GET /v1/scans/{scan}/bundle` refuses; when the file exists or cannot be written.
    pub fn run(self) -> anyhow::Result<()> {
        tokio::runtime::Runtime::new()?.block_on(self.write())
    }

    async fn write(self) -> anyhow::Result<()> {
        let scan = Name::new(self.scan)?;
        let (_, store) = self.place.open().await?;
        let app = App::new(store.clone(), Policy::default());
        let zip = bundle::zip_of(&app, &Caller::default(), &scan, self.layout, self.partial).await;
        let zip = zip.map_err(|error| anyhow!("{}", error.fault().detail))?;
        let out = self.out.unwrap_or_else(|| bundle::file_name(&scan, self.layout).into());
        let cannot = || format!("cannot write {}", out.display());
        let mut file = std::fs::File::options().create_new(true).write(true).open(&out).with_context(cannot)?;
        let mut chunks = std::pin::pin!(zip.stream(store.blobs, 0, zip.length()));
        while let Some(chunk) = chunks.next().await {
            file.write_all(&chunk.context("cannot read a result")?).with_context(cannot)?;
        }
        file.sync_all().with_context(cannot)?;
        store.metadata.close().await;
        say(format!("{}: {} bytes", out.display(), zip.length()));
        Ok(())
    }
}
