//! How much of an epoch each of several sets gives.

/// Most of an epoch that one of several sets may give: a set of many short characters must not decide alone.
const LARGEST_SHARE: f64 = 0.35;

/// Examples that each set may give, of `counts` that it has: no set more than [`LARGEST_SHARE`] of what
/// remains, or its even share where sets are few.
pub(super) fn caps(counts: &[usize]) -> Vec<usize> {
    let share = LARGEST_SHARE.max(1.0 / counts.len().max(1) as f64);
    let below = |cap: usize| counts.iter().map(move |count| (*count).min(cap));
    let mut cap = counts.iter().sum();
    // What is left out shrinks the epoch, and with it what each share is of. Falls from step to step.
    loop {
        let next = (below(cap).sum::<usize>() as f64 * share).ceil() as usize;
        if next >= cap {
            return below(cap).collect();
        }
        cap = next;
    }
}

#[cfg(test)]
mod tests {
    use super::caps;

    #[test]
    fn no_set_outweighs_the_others() {
        for counts in [&[900, 50, 40, 10][..], &[300, 290, 280, 5000], &[10, 10, 10], &[1, 0, 7, 7000]] {
            let caps = caps(counts);
            let total: usize = caps.iter().sum();
            let largest = *caps.iter().max().unwrap();
            assert!(
                largest as f64 <= (0.35_f64).max(1.0 / counts.len() as f64) * total as f64 + 1.0,
                "{caps:?}"
            );
            assert!(caps.iter().zip(counts).all(|(cap, count)| cap <= count));
            let whole = |(cap, count): (&usize, &usize)| *cap == (*count).min(largest);
            assert!(caps.iter().zip(counts).all(whole), "only what is too much is left out: {caps:?}");
        }
        assert_eq!(caps(&[12, 0, 13, 12]), [12, 0, 13, 12]);
        // One set is the whole of an epoch.
        assert_eq!(caps(&[77]), [77]);
    }
}
