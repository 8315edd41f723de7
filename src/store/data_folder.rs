//! The data folder: a store in one folder. The only place that names the engines.
//!
//! ```text
//! {data_dir}/pinstack.sqlite      metadata, in SQLite, unless it is in Postgres
//! {data_dir}/blobs, partial, spool    see `store::local`
//! ```

use std::{
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
};

use super::{
    Clock, MetadataStore, S3Location, Store, StoreError, StoreResult, SystemClock, Workspace,
    blobs::{RESULTS, UPLOADS},
    failpoint::step,
    folder::{self, DATABASE, remove, sync_folder},
    local,
    postgres::{DatabaseUrl, PostgresMetadata},
    s3,
    sqlite::SqliteMetadata,
};

/// Opens the store in `data_dir`, creates what is missing, and migrates the schema.
///
/// # Errors
/// When the folder or the database cannot be used, or a newer version of the program wrote the database.
pub async fn open(data_dir: &Path) -> StoreResult<Store> {
    open_with_clock(data_dir, Arc::new(SystemClock)).await
}

/// The same with another clock, for tests.
///
/// # Errors
/// As [`open`].
pub async fn open_with_clock(data_dir: &Path, clock: Arc<dyn Clock>) -> StoreResult<Store> {
    let metadata = Arc::new(SqliteMetadata::open_with_clock(data_dir.join(DATABASE), clock).await?);
    // folders are made, which a full disk may refuse
    metadata.freeing(|| async { Store::new(metadata.clone(), data_dir) }).await
}

/// Opens the metadata alone, for commands that need no blobs.
///
/// # Errors
/// As [`open`].
pub async fn open_metadata(data_dir: &Path) -> StoreResult<Arc<dyn MetadataStore>> {
    open_database(&data_dir.join(DATABASE)).await
}

/// Where a store that several machines may share keeps what is not in its data folder.
#[derive(Debug, Clone, Default)]
pub struct Shared {
    /// The Postgres database with the metadata; `None`: SQLite in the data folder.
    pub database: Option<DatabaseUrl>,
    /// The bucket with blobs and upload parts, for which a Postgres database is needed; `None`: the data folder.
    pub storage: Option<S3Location>,
}

/// Opens the store in `data_dir`, with its metadata in Postgres and its files in a bucket, if `shared` names them.
/// Processes of several machines share such a store: each opens the same database, and the same bucket, or the same
/// folder on a common file system. With a bucket, the folder holds the scratch files of this machine alone.
///
/// # Errors
/// As [`open`]; when the database or the bucket cannot be reached, or do not belong together; and when the folder has a
/// database or files of its own, which would not be seen any more.
pub async fn open_shared(data_dir: &Path, shared: &Shared) -> StoreResult<Store> {
    let Some(url) = &shared.database else {
        if shared.storage.is_some() {
            return Err(anyhow::anyhow!(
                "storage_url needs database_url: SQLite is for one machine, with its files on its own disk"
            )
            .into());
        }
        return open(data_dir).await;
    };
    let metadata = open_postgres(data_dir, url).await?;
    let Some(location) = &shared.storage else {
        metadata.store_in_folder().await?;
        return Store::new(Arc::new(metadata), data_dir);
    };
    refuse_files(data_dir)?;
    let id = metadata.store_id(&location.url).await?;
    let (blobs, parts) = s3::open(location, id).await?;
    metadata.store_in_bucket(&location.url).await?;
    let workspace = folder::make(data_dir).and_then(|()| Workspace::open(data_dir));
    let workspace =
        workspace.map_err(|error| StoreError::of_io(error, format!("cannot use the folder {}", data_dir.display())))?;
    Ok(Store {
        metadata: Arc::new(metadata),
        blobs: Arc::new(blobs),
        parts: Arc::new(parts),
        workspace: Arc::new(workspace),
    })
}

/// Requires that the data folder has no uploads and results of its own.
fn refuse_files(data_dir: &Path) -> StoreResult<()> {
    let has_files =
        |prefix| fs::read_dir(data_dir.join("blobs").join(prefix)).is_ok_and(|mut files| files.next().is_some());
    if has_files(UPLOADS) || has_files(RESULTS) {
        return Err(anyhow::anyhow!(
            "storage_url: {} has files of stacks, which would not be seen; use a new data_dir with the bucket and move \
             the old one into it (pinstack restore --from)",
            data_dir.display()
        )
        .into());
    }
    Ok(())
}

/// The metadata of such a store alone.
///
/// # Errors
/// As [`open_shared`].
pub async fn open_shared_metadata(
    data_dir: &Path,
    database: Option<&DatabaseUrl>,
) -> StoreResult<Arc<dyn MetadataStore>> {
    match database {
        Some(url) => Ok(Arc::new(open_postgres(data_dir, url).await?)),
        None => open_metadata(data_dir).await,
    }
}

async fn open_postgres(data_dir: &Path, url: &DatabaseUrl) -> StoreResult<PostgresMetadata> {
    if exists(data_dir) {
        let error = anyhow::anyhow!(
            "database_url: {} has a SQLite database already, and its stacks would not be seen; use a new data_dir with \
             Postgres and move the old one into it (pinstack restore --from), or unset database_url",
            data_dir.display()
        );
        return Err(error.into());
    }
    PostgresMetadata::open(url).await
}

/// Moves the rows of a database file into a Postgres database that has none yet.
///
/// # Errors
/// As [`PostgresMetadata::fill_from`].
pub async fn fill_database(url: &DatabaseUrl, file: &Path) -> StoreResult<()> {
    let metadata = PostgresMetadata::open(url).await?;
    let filled = metadata.fill_from(file).await;
    metadata.close().await;
    filled
}

/// Requires that a Postgres database has no rows, before files are copied for it.
///
/// # Errors
/// When it has, or cannot be reached.
pub async fn require_empty(url: &DatabaseUrl) -> StoreResult<()> {
    let metadata = PostgresMetadata::open(url).await?;
    let empty = metadata.require_empty().await;
    metadata.close().await;
    empty
}

/// Removes a database file and what SQLite keeps beside it.
///
/// # Errors
/// When they cannot be removed.
pub fn remove_file(file: &Path) -> io::Result<()> {
    remove_database(file)?;
    remove(&beside(file, ".lock"))
}

/// True when the folder has a database.
pub fn exists(data_dir: &Path) -> bool {
    data_dir.join(DATABASE).is_file()
}

impl Store {
    /// Joins metadata with the blobs, parts and workspace in `data_dir`.
    pub(super) fn new(metadata: Arc<dyn MetadataStore>, data_dir: &Path) -> StoreResult<Self> {
        let (blobs, parts, workspace) = local::open(data_dir)?;
        Ok(Self { metadata, blobs: Arc::new(blobs), parts: Arc::new(parts), workspace: Arc::new(workspace) })
    }
}

/// Opens a database file.
pub(super) async fn open_database(file: &Path) -> StoreResult<Arc<dyn MetadataStore>> {
    Ok(Arc::new(SqliteMetadata::open(file).await?))
}

/// Removes a database file and its journal.
pub(super) fn remove_database(file: &Path) -> io::Result<()> {
    [file, &beside(file, "-wal"), &beside(file, "-shm")].into_iter().try_for_each(remove)
}

/// Durably replaces the database of a data folder with the file `new`, which is closed.
pub(super) async fn replace_database(new: &Path, data_dir: &Path) -> StoreResult<()> {
    let database = data_dir.join(DATABASE);
    if database.exists() {
        // the journal of a database that was not closed must not be applied to the new file
        open_database(&database).await?.close().await;
    }
    let replaced = rename_durably(new, &database, data_dir);
    replaced.map_err(|error| super::StoreError::of_io(error, format!("cannot replace {}", database.display())))
}

fn rename_durably(new: &Path, database: &Path, folder: &Path) -> io::Result<()> {
    step("backup.sync")?;
    fs::File::options().write(true).open(new)?.sync_all()?;
    step("backup.rename")?;
    fs::rename(new, database)?;
    sync_folder(folder)
}

fn beside(file: &Path, ending: &str) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(ending);
    name.into()
}
