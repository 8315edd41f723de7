//! The budget on a disk that the test fills.

use std::sync::atomic::Ordering;

use tempfile::TempDir;
use tokio::task::JoinSet;

use super::*;
use crate::store::{
    conformance::{
        disk::{SmallDisk, TOTAL},
        memory::MemoryBlobStore,
    },
    open,
};

async fn budget(min_free: u64) -> (TempDir, Arc<SmallDisk>, Arc<DiskBudget>) {
    let folder = tempfile::tempdir().expect("a folder");
    let store = open(folder.path()).await.expect("a store");
    let disk = Arc::new(SmallDisk::over(Arc::clone(&store.blobs), TOTAL));
    let store = Store { blobs: disk.clone(), ..store };
    (folder, disk, DiskBudget::new(&store, min_free))
}

/// Pseudo-random numbers; the same at each run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, most: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % most
    }
}

#[tokio::test]
async fn only_a_file_that_is_not_on_this_machine_needs_space_for_a_copy() {
    let folder = tempfile::tempdir().expect("a folder");
    let store = open(folder.path()).await.expect("a store");
    // no space at all
    let local = DiskBudget::new(&store, u64::MAX);
    assert!(local.reserve_copy(1).await.expect("measured").granted().is_ok());
    let elsewhere = DiskBudget::new(&MemoryBlobStore::under(store), u64::MAX);
    assert!(elsewhere.reserve_copy(1).await.expect("measured").granted().is_err());
}

#[tokio::test]
async fn a_reservation_that_does_not_fit_is_refused_with_the_figures() {
    let (_folder, disk, budget) = budget(100).await;
    let held = budget.reserve(600).await.expect("measured").granted().expect("it fits");
    let figures = budget.reserve(301).await.expect("measured").granted().expect_err("300 are available");
    assert_eq!(figures, DiskState { free: TOTAL, total: TOTAL, reserved: 600, min_free: 100 });
    assert!(
        budget.reserve_beside(100, 201).await.expect("measured").granted().is_err(),
        "what is to come must fit too"
    );
    assert!(budget.reserve(u64::MAX).await.expect("measured").granted().is_err());
    let beside = budget.reserve_beside(100, 200).await.expect("measured").granted().expect("it fits");
    assert_eq!((budget.reserved(), beside.bytes()), (700, 100), "what is to come is not reserved");
    drop((held, beside));
    assert_eq!(budget.reserved(), 0);
    disk.free.store(0, Ordering::SeqCst);
    assert!(budget.reserve(1).await.expect("measured").granted().is_err());
}

#[tokio::test]
async fn written_bytes_are_counted_by_the_disk_and_no_longer_by_the_reservation() {
    let (_folder, disk, budget) = budget(0).await;
    let mut held = budget.reserve(600).await.expect("measured").granted().expect("it fits");
    disk.free.fetch_sub(400, Ordering::SeqCst);
    held.written(400);
    assert_eq!((held.bytes(), budget.reserved()), (200, 200));
    let more = budget.reserve(400).await.expect("measured").granted().expect("600 are free, 200 reserved");
    held.absorb(more);
    assert_eq!((held.bytes(), budget.reserved()), (600, 600));
    held.written(u64::MAX);
    drop(held);
    assert_eq!(budget.reserved(), 0, "nothing is returned twice");
}

#[tokio::test]
async fn reservations_never_exceed_what_is_free() {
    let (_folder, disk, budget) = budget(50).await;
    for seed in 0..20 {
        let mut dice = Dice(seed);
        let mut held: Vec<Reservation> = Vec::new();
        for _ in 0..300 {
            match dice.below(5) {
                0 | 1 => {
                    if let Ok(reservation) = budget.reserve(dice.below(400)).await.expect("measured").granted() {
                        held.push(reservation);
                    }
                }
                2 if !held.is_empty() => {
                    let at = dice.below(held.len() as u64) as usize;
                    let bytes = dice.below(held[at].bytes() + 1);
                    disk.free.fetch_sub(bytes, Ordering::SeqCst);
                    held[at].written(bytes);
                }
                3 if !held.is_empty() => drop(held.swap_remove(dice.below(held.len() as u64) as usize)),
                // files are deleted
                _ => {
                    let used = TOTAL - disk.free.load(Ordering::SeqCst);
                    disk.free.fetch_add(dice.below(used + 1), Ordering::SeqCst);
                }
            }
            let sum: u64 = held.iter().map(Reservation::bytes).sum();
            assert_eq!(budget.reserved(), sum, "seed {seed}");
            assert!(sum == 0 || sum + 50 <= disk.free.load(Ordering::SeqCst), "seed {seed}: {sum} reserved");
        }
        held.clear();
    }
}

/// The measurement of the disk is older than the grant: writers that finish between the two must not be missed.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn writers_at_the_same_time_never_fill_what_must_stay_free() {
    let (_folder, disk, budget) = budget(50).await;
    let mut writers = JoinSet::new();
    for seed in 0..8 {
        let (disk, budget) = (Arc::clone(&disk), Arc::clone(&budget));
        writers.spawn(async move {
            let mut dice = Dice(seed);
            for _ in 0..500 {
                let Ok(mut held) = budget.reserve(1 + dice.below(300)).await.expect("measured").granted() else {
                    continue;
                };
                let mut files = 0;
                while held.bytes() > 0 {
                    let bytes = 1 + dice.below(held.bytes());
                    let before = disk.free.fetch_sub(bytes, Ordering::SeqCst);
                    assert!(before >= bytes + 50, "{bytes} bytes were written with {before} free");
                    held.written(bytes);
                    files += bytes;
                    tokio::task::yield_now().await;
                }
                disk.free.fetch_add(files, Ordering::SeqCst);
            }
        });
    }
    while let Some(ended) = writers.join_next().await {
        ended.expect("a writer");
    }
    assert_eq!((budget.reserved(), disk.free.load(Ordering::SeqCst)), (0, TOTAL));
}
