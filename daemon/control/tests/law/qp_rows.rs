//! The box with rows: certificates, a second solver, and rows that contradict each other.

use foretrace_clarabel::ClarabelProfile;
use foretrace_control::qp::backend::OtherSolver;
use foretrace_control::qp::box_qp;
use foretrace_control::qp::row_qp::{PENALTY, RowSet, solve};
use foretrace_control::qp::{KKT_TOLERANCE, QpStatus};
use nalgebra::{SMatrix, SVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

type Matrix = SMatrix<f64, 6, 6>;
type Vector = SVector<f64, 6>;

struct Case {
    h: Matrix,
    g: Vector,
    lower: Vector,
    upper: Vector,
    rows: RowSet<6>,
}

fn case(rng: &mut Pcg64, count: usize, damping: f64) -> Case {
    let a = Matrix::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let h = a.transpose() * a + Matrix::identity() * damping;
    let g = Vector::from_fn(|_, _| rng.random_range(-2.0..2.0));
    let middle = Vector::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let width = Vector::from_fn(|_, _| rng.random_range(0.0..1.0));
    let mut rows = RowSet::default();
    for k in 0..count {
        let c: [f64; 6] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
        let at: f64 = c.iter().zip(&middle).map(|(c, m)| c * m).sum();
        rows.put(k, &c, at + rng.random_range(-0.8..0.4));
    }
    Case { h, g, lower: middle - width, upper: middle + width, rows }
}

fn cost(case: &Case, x: &Vector) -> f64 {
    let broken: f64 = case.rows.iter().map(|(c, b)| (b - Vector::from(*c).dot(x)).max(0.0)).sum();
    (0.5 * case.h * x + case.g).dot(x) + PENALTY * broken
}

/// Convex: no nearby point is cheaper, in any direction that stays in the box.
#[test]
fn no_neighbour_in_the_box_is_cheaper() {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut seen = [0usize; 3];
    for round in 0..6_000 {
        let damping = [1e-9, 1e-3, 1.0][round % 3];
        let case = case(&mut rng, round % 19, damping);
        let found = solve(&case.h, &case.g, &case.lower, &case.upper, &case.rows);
        assert_eq!(found.status, QpStatus::Optimal, "{round} {found:?}");
        assert!(found.kkt_residual <= KKT_TOLERANCE);
        let here = cost(&case, &found.x);
        for _ in 0..40 {
            let size = 10f64.powf(rng.random_range(-6.0..0.0));
            let near = found.x + Vector::from_fn(|_, _| rng.random_range(-size..size));
            let near = near.zip_zip_map(&case.lower, &case.upper, |x, l, u| x.max(l).min(u));
            assert!(cost(&case, &near) >= here - 1e-7, "{round}: {} {here}", cost(&case, &near));
        }
        for i in 0..6 {
            assert!(found.x[i] >= case.lower[i] && found.x[i] <= case.upper[i]);
        }
        seen[0] += usize::from(found.held != 0);
        seen[1] += usize::from(found.yielded != 0);
        seen[2] += usize::from(found.held.count_ones() >= 2 && found.active.count() >= 1);
    }
    assert!(seen[0] > 2_000 && seen[1] > 500 && seen[2] > 300, "{seen:?}");
}

#[test]
fn clarabel_finds_the_same_minimum() {
    let mut rng = Pcg64::seed_from_u64(2);
    for round in 0..300 {
        let case = case(&mut rng, 6, 1e-2);
        let exact = solve(&case.h, &case.g, &case.lower, &case.upper, &case.rows);
        let mut matrix = Vec::new();
        let mut lower: Vec<f64> = case.lower.iter().copied().collect();
        let mut upper: Vec<f64> = case.upper.iter().copied().collect();
        for i in 0..6 {
            matrix.push(std::array::from_fn::<f64, 6, _>(|j| f64::from(u8::from(i == j))));
        }
        for (c, b) in case.rows.iter() {
            matrix.push(*c);
            lower.push(b);
            // Never reached, but finite, because an interior point far from all bounds is slow to find.
            upper.push(b.abs() + 20.0);
        }
        let penalties = [[f64::INFINITY; 6], [PENALTY; 6]].concat();
        let mut other = ClarabelProfile::Default.set_up(matrix.as_flattened(), 6, &penalties).unwrap();
        let (mut x, mut z) = (Vector::zeros(), [0.0; 12]);
        let solved =
            other.solve(case.h.as_slice(), case.g.as_slice(), &lower, &upper, x.as_mut_slice(), &mut z);
        assert!(solved.status.usable(), "{round} {:?}", solved.status);
        let (ours, theirs) = (cost(&case, &exact.x), cost(&case, &x));
        assert!(ours <= theirs + 1e-4, "{round}: {ours} {theirs}");
        assert!((exact.x - x).norm() < 1e-2, "{round}: {} {x}", exact.x);
    }
}

#[test]
fn without_rows_the_answer_is_that_of_the_box() {
    let mut rng = Pcg64::seed_from_u64(3);
    for _ in 0..1_000 {
        let case = case(&mut rng, 0, 1e-3);
        let with = solve(&case.h, &case.g, &case.lower, &case.upper, &case.rows);
        let without = box_qp::solve(&case.h, &case.g, &case.lower, &case.upper);
        assert!((with.x - without.x).amax() < 1e-12);
        assert_eq!(with.active, without.active);
    }
}

/// Two walls that face each other with no room between: the answer stays between them instead of failing.
#[test]
fn contradicting_rows_share_the_violation_and_the_box_holds() {
    let mut rows = RowSet::<6>::default();
    rows.put(0, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.5);
    rows.put(1, &[-1.0, 0.0, 0.0, 0.0, 0.0, 0.0], 0.5);
    rows.put(2, &[0.0, 1.0, 0.0, 0.0, 0.0, 0.0], 3.0);
    let (lower, upper) = (Vector::repeat(-1.0), Vector::repeat(1.0));
    let found = solve(&Matrix::identity(), &Vector::zeros(), &lower, &upper, &rows);
    assert_eq!(found.status, QpStatus::Optimal, "{found:?}");
    assert!(found.x[0].abs() <= 0.5 && found.x[1] == 1.0, "{found:?}");
    assert!(found.yielded >> 2 & 1 == 1);
}

#[test]
fn hostile_numbers_are_refused_and_the_answer_stays_in_the_box() {
    let (lower, upper) = (Vector::repeat(0.25), Vector::repeat(1.0));
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut rows = RowSet::<6>::default();
        rows.put(0, &[bad, 0.0, 0.0, 0.0, 0.0, 0.0], 0.0);
        let found = solve(&Matrix::identity(), &Vector::zeros(), &lower, &upper, &rows);
        assert_eq!((found.status, found.x), (QpStatus::NotFinite, lower));
    }
    let mut rows = RowSet::<6>::default();
    for k in 0..100 {
        rows.put(k, &[1.0; 6], f64::from(k as u32));
    }
    assert_eq!(rows.len(), RowSet::<6>::CAPACITY);
}

#[test]
fn a_row_set_holds_what_was_put_in_order() {
    let mut rows = RowSet::<2>::default();
    assert_eq!((rows.is_empty(), rows.len()), (true, 0));
    rows.put(1, &[1.0, 1.0], 1.0);
    assert!(rows.is_empty(), "there is no row before it");
    for k in 0..RowSet::<2>::CAPACITY {
        rows.put(k, &[k as f64, 1.0], -(k as f64));
        assert!(!rows.is_empty() && rows.len() == k + 1);
    }
    let full = rows;
    rows.put(RowSet::<2>::CAPACITY, &[9.0, 9.0], 9.0);
    assert_eq!(rows, full, "there is no room for one more");
    rows.put(2, &[7.0, 8.0], 9.0);
    let held: Vec<_> = rows.iter().map(|(c, lower)| (*c, lower)).collect();
    let expected = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0].map(|k| ([k, 1.0], -k));
    assert_eq!(held[..2], expected[..2]);
    assert_eq!((held[2], &held[3..]), (([7.0, 8.0], 9.0), &expected[3..]));
    // k x + y ≥ −k: at x = −1 all ask for y ≥ 0.
    assert!(full.kept_by(&[-1.0, 0.0], 0.0) && !full.kept_by(&[-1.0, -0.5], 0.4));
    assert!(full.kept_by(&[-1.0, -0.5], 0.5) && !full.kept_by(&[-2.0, 0.0], 1.0));
    rows.clear();
    assert!(rows.is_empty() && rows == RowSet::default() && rows.kept_by(&[f64::NAN; 2], 0.0));
}
