//! Pages of lists.

/// One page of a list, newest entry first.
#[derive(Debug, Clone, PartialEq)]
pub struct Page<T> {
    /// The entries, at most as many as requested.
    pub items: Vec<T>,
    /// Cursor of the next page; `None` on the last page.
    pub next_cursor: Option<String>,
    /// Rows of this page that cannot be read. They are not among the items.
    pub skipped: Vec<Skipped>,
}

impl<T> Page<T> {
    /// The page of these rows. `read` gives the entry of a row, or what is said of one that cannot be read.
    pub(crate) fn of_rows<R>(
        rows: Vec<R>,
        next_cursor: Option<String>,
        read: impl Fn(R) -> Result<T, Skipped>,
    ) -> Self {
        let mut page = Self { items: Vec::new(), next_cursor, skipped: Vec::new() };
        for row in rows {
            match read(row) {
                Ok(item) => page.items.push(item),
                Err(skipped) => page.skipped.push(skipped),
            }
        }
        page
    }
}

/// A row that cannot be read. The log has the reason; `pinstack verify` reports the row too.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize, utoipa::ToSchema)]
pub struct Skipped {
    /// Id of the job or upload, or `{rig}/{lens}?revision={N}` of a profile.
    pub id: String,
    /// What to do.
    pub detail: String,
}

impl Skipped {
    /// Omits a row from a list and logs why.
    pub(crate) fn unreadable(id: String, error: &dyn std::fmt::Debug) -> Self {
        tracing::error!(row = id, ?error, "a row cannot be read; lists omit it");
        let detail = "this row cannot be read and is omitted; see the log of the service, or run 'pinstack verify'";
        Self { id, detail: detail.to_owned() }
    }
}

/// Which page of a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageRequest {
    /// Largest number of entries, 1 to 500.
    pub limit: u32,
    /// `next_cursor` of the previous page; `None` for the first page.
    pub cursor: Option<String>,
}
