//! `pinstack target`: a dot target to print, without a server.

use std::path::PathBuf;

use anyhow::{Context, anyhow, bail};
use clap::{Args, ValueEnum};

use super::output::say;
use pinstack_science::optics::page::{self, PageFormat, TargetInput, TargetPage};

/// Write a dot target to print, as PDF or SVG at true scale
#[derive(Debug, Args)]
pub struct Target {
    /// Distance of neighbouring dots, mm
    #[arg(long, value_name = "MM")]
    pitch_mm: f64,
    /// Number of columns
    #[arg(long, value_name = "N")]
    columns: u32,
    /// Number of rows
    #[arg(long, value_name = "N")]
    rows: u32,
    /// Dots of two sizes, which make every dot unique
    #[arg(long)]
    coded: bool,
    /// Diameter of a dot divided by the pitch
    #[arg(long, value_name = "SHARE", default_value_t = 0.5)]
    dot_ratio: f64,
    /// White dots on black
    #[arg(long)]
    inverted: bool,
    /// Size of the page
    #[arg(long, value_enum, default_value_t = Paper::A4)]
    paper: Paper,
    /// File to write, .pdf or .svg
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Size of the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Paper {
    /// 210 x 297 mm
    A4,
    /// 8.5 x 11 inches
    Letter,
    /// The size of the target, for photo services
    Fit,
}

impl Target {
    /// Runs the command.
    ///
    /// # Errors
    /// What [`TargetPage::new`] refuses; another extension than `.pdf` and `.svg`; when the file cannot be written.
    pub fn run(self) -> anyhow::Result<()> {
        let format = match self.out.extension().and_then(|extension| extension.to_str()) {
            Some("pdf") => PageFormat::Pdf,
            Some("svg") => PageFormat::Svg,
            _ => bail!("{} must end in .pdf or .svg", self.out.display()),
        };
        let input = TargetInput {
            pitch_mm: self.pitch_mm,
            columns: self.columns,
            rows: self.rows,
            coded: self.coded,
            dot_ratio: self.dot_ratio,
            inverted: self.inverted,
            paper: match self.paper {
                Paper::A4 => page::Paper::A4,
                Paper::Letter => page::Paper::Letter,
                Paper::Fit => page::Paper::Fit,
            },
            format,
        };
        let page = TargetPage::new(&input).map_err(|error| anyhow!("{}", error.detail))?;
        let bytes = match format {
            PageFormat::Pdf => page.pdf(),
            PageFormat::Svg => page.svg().into_bytes(),
        };
        std::fs::write(&self.out, bytes).with_context(|| format!("cannot write {}", self.out.display()))?;
        say(format!("{}: {:.1} x {:.1} mm", self.out.display(), page.width, page.height));
        Ok(())
    }
}
