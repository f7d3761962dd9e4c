//! Independent jobs over the machine's cores, results in the order of the jobs.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// A whole control law is built on the worker's stack.
const STACK_BYTES: usize = 16 << 20;

/// Runs `work` on every job; calls `done` after each.
pub(crate) fn map<J: Sync, R: Send>(
    jobs: &[J],
    work: impl Fn(&J) -> R + Sync,
    mut done: impl FnMut(),
) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(jobs.len());
    let mut results: Vec<Option<R>> = jobs.iter().map(|_| None).collect();
    let work = &work;
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::channel();
        for _ in 0..threads {
            let (sender, next, work) = (sender.clone(), &next, &work);
            let job = move || {
                while let Some((index, job)) = take(jobs, next) {
                    // The receiver outlives every worker.
                    let _ = sender.send((index, work(job)));
                }
            };
            if std::thread::Builder::new().stack_size(STACK_BYTES).spawn_scoped(scope, job).is_err() {
                break;
            }
        }
        drop(sender);
        for (index, result) in receiver {
            if let Some(slot) = results.get_mut(index) {
                *slot = Some(result);
            }
            done();
        }
        // If no thread could be started, this one does the remaining jobs.
        while let Some((index, job)) = take(jobs, &next) {
            if let Some(slot) = results.get_mut(index) {
                *slot = Some(work(job));
            }
            done();
        }
    });
    results.into_iter().flatten().collect()
}

fn take<'a, J>(jobs: &'a [J], next: &AtomicUsize) -> Option<(usize, &'a J)> {
    let index = next.fetch_add(1, Ordering::Relaxed);
    jobs.get(index).map(|job| (index, job))
}

#[cfg(test)]
mod tests {
    use super::map;

    #[test]
    fn results_stand_in_the_order_of_the_jobs() {
        let jobs: Vec<u64> = (0..200).collect();
        let mut finished = 0;
        let squares = map(&jobs, |n| n * n, || finished += 1);
        assert_eq!(squares, jobs.iter().map(|n| n * n).collect::<Vec<_>>());
        assert_eq!(finished, 200);
    }
}
