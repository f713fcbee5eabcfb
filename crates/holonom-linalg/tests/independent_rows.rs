//! Independent rows of tall sparse matrices against dense elimination and singular values.

mod common;

use common::{cases, noise};
use holonom_linalg::{
    Claim, OfferedRow, SparseLu, SparsePattern, full_pivot_elimination, independent_rows,
    singular_values,
};
use proptest::prelude::*;

fn dense(rows: &[OfferedRow], columns: usize, which: &[usize]) -> Vec<f64> {
    let mut a = vec![0.0; which.len() * columns];
    for (out, &i) in a.chunks_exact_mut(columns).zip(which) {
        rows[i].entries.iter().for_each(|&(j, x)| out[j] = x);
    }
    a
}

fn condition(rows: &[OfferedRow], columns: usize, which: &[usize]) -> f64 {
    let s = singular_values(columns, columns, &dense(rows, columns, which)).unwrap();
    s[0] / s[columns - 1]
}

fn rank(rows: &[OfferedRow], columns: usize, which: &[usize]) -> usize {
    let mut a = dense(rows, columns, which);
    full_pivot_elimination(which.len(), columns, &mut a, &[], 1e-9).rank
}

/// Rows as of a mechanism: each block has a preferred row for each column and its parent's; some are
/// required; closures tie random blocks, and some of them are sums of others.
fn mechanism(blocks: usize, width: usize, closures: usize, seed: u64) -> Vec<OfferedRow> {
    let numbers = noise(seed, 4000);
    let mut at = 0;
    let mut next = || {
        at = (at + 1) % numbers.len();
        numbers[at]
    };
    let row = |blocks: &[usize], claim, next: &mut dyn FnMut() -> f64| OfferedRow {
        entries: (blocks.iter().flat_map(|b| b * width..(b + 1) * width))
            .map(|j| (j, next()))
            .collect(),
        claim,
    };
    let (mut required, mut preferred) = (Vec::new(), Vec::new());
    for b in 0..blocks {
        let parent = ((next() + 1.0) * 0.5 * b as f64) as usize;
        let tied: &[usize] = if b == 0 { &[0] } else { &[parent, b] };
        for k in 0..width {
            let held = k > 0 && next() < 0.3;
            let claim = if held { Claim::Required(0) } else { Claim::InTurn(1.0) };
            let mut made = row(tied, claim, &mut next);
            // Each its own column: regular by itself.
            made.entries.iter_mut().for_each(|(j, x)| {
                if *j / width == b {
                    *x = 0.3 * *x + if *j == b * width + k { 1.0 } else { 0.0 };
                }
            });
            if held { required.push(made) } else { preferred.push(made) }
        }
    }
    for c in 0..closures {
        let pick = |x: f64| (((x + 1.0) * 0.5 * blocks as f64) as usize).min(blocks - 1);
        let (i, j) = (pick(next()), pick(next()));
        let tied: Vec<usize> = if i == j { vec![i] } else { vec![i, j] };
        if c % 3 == 2 && !required.is_empty() {
            // A multiple of a row, and a sum of two.
            let one = required[pick(next()) % required.len()].clone();
            let other = required[pick(next()) % required.len()].clone();
            let mut sum = vec![0.0; blocks * width];
            one.entries.iter().for_each(|&(j, x)| sum[j] += x);
            other.entries.iter().for_each(|&(j, x)| sum[j] -= 0.5 * x);
            let entries = sum.into_iter().enumerate().filter(|(_, x)| *x != 0.0).collect();
            required.push(OfferedRow { entries, claim: Claim::Required(1) });
        } else {
            required.push(row(&tied, Claim::Required(1), &mut next));
        }
    }
    required.extend(preferred);
    required
}

proptest! {
    #![proptest_config(cases(300))]

    // truth: ranks by dense elimination with full pivoting; the condition of what that takes of the
    // preferred rows after the required ones
    #[test]
    fn rows_are_as_many_as_dense_elimination_finds_and_about_as_well_conditioned(
        blocks in 1usize..12, width in 1usize..4, closures in 0usize..9, seed: u64,
    ) {
        let rows = mechanism(blocks, width, closures, seed);
        let columns = blocks * width;
        let all: Vec<usize> = (0..rows.len()).collect();
        let required: Vec<usize> = all.iter().copied()
            .filter(|&i| matches!(rows[i].claim, Claim::Required(_))).collect();
        prop_assume!(rank(&rows, columns, &all) == columns);
        let found = independent_rows(blocks, width, &rows, 1e-9, 0.4).unwrap();
        prop_assert_eq!(found.taken.len(), columns);
        let held = rank(&rows, columns, &required);
        prop_assert_eq!(found.redundant.len(), required.len() - held);
        let kept: Vec<usize> =
            required.iter().copied().filter(|i| !found.redundant.contains(i)).collect();
        prop_assert!(kept.iter().all(|i| found.taken.contains(i)));

        let mut best = Vec::new();
        let mut a = dense(&rows, columns, &required);
        let order = full_pivot_elimination(required.len(), columns, &mut a, &[], 1e-9);
        best.extend(order.row_order[..order.rank].iter().map(|&i| required[i]));
        // Preferred rows, each the one with the most left beside those taken.
        while best.len() < columns {
            let least = |i: usize| {
                let mut with = best.clone();
                with.push(i);
                let s = singular_values(with.len(), columns, &dense(&rows, columns, &with)).unwrap();
                s[with.len() - 1]
            };
            let more = (required.len()..rows.len()).filter(|i| !best.contains(i));
            let taken = more.max_by(|&i, &j| least(i).total_cmp(&least(j))).unwrap();
            best.push(taken);
        }
        let (here, there) = (condition(&rows, columns, &found.taken), condition(&rows, columns, &best));
        prop_assert!(here < 30.0 * there, "{} against {}", here, there);
    }

    // truth: solutions for unit vectors
    #[test]
    fn entries_of_the_inverse(n in 1usize..20, seed: u64) {
        let numbers = noise(seed, n * n + n);
        let mut entries: Vec<(usize, usize)> = (0..n).map(|i| (i, (i * 7 + 3) % n)).collect();
        entries.extend((0..2 * n).map(|k| ((k * 5 + 1) % n, (numbers[k % n].abs() * n as f64) as usize % n)));
        entries.extend((0..n).map(|i| (i, i)));
        let (pattern, slots) = SparsePattern::new(n, n, &entries);
        let mut values = vec![0.0; pattern.len()];
        for (k, slot) in slots.iter().enumerate() {
            values[*slot] += numbers[n + k % (n * n)] + if k >= 3 * n { 2.0 } else { 0.0 };
        }
        let Ok(mut lu) = SparseLu::analyze(&pattern, &values) else { return Ok(()) };
        prop_assume!(lu.condition_estimate(&pattern, &values) < 1e6);
        let inverse = lu.inverse_entries(&pattern);
        for i in 0..n {
            let mut column = vec![0.0; n];
            column[i] = 1.0;
            lu.solve(&mut column);
            for (slot, j) in pattern.row(i) {
                prop_assert!((inverse[slot] - column[j]).abs() < 1e-8 * (1.0 + column[j].abs()));
            }
        }
    }
}

/// A planar ladder: blocks 3i, 3i + 1, 3i + 2 are its low, high and rung bodies.
fn ladder(loops: usize) -> Vec<OfferedRow> {
    let pin = |a: Option<(usize, [f64; 2])>, b: (usize, [f64; 2]), claim| {
        let row = |k: usize| {
            let mut entries = Vec::new();
            for (sign, (body, arm)) in a.into_iter().map(|a| (-1.0, a)).chain([(1.0, b)]) {
                let turn: f64 = [-arm[1], arm[0]][k];
                entries.push((3 * body + k, sign));
                if turn != 0.0 {
                    entries.push((3 * body + 2, sign * turn));
                }
            }
            OfferedRow { entries, claim }
        };
        [row(0), row(1)]
    };
    let angle = |a: Option<usize>, b: usize| OfferedRow {
        entries: a.map(|a| (3 * a + 2, -1.0)).into_iter().chain([(3 * b + 2, 1.0)]).collect(),
        claim: Claim::InTurn(1.0),
    };
    let (mut rows, mut angles) = (Vec::new(), Vec::new());
    for i in 0..loops {
        let [low, high, rung] = [3 * i, 3 * i + 1, 3 * i + 2];
        let (forest, closing) = (Claim::Required(0), Claim::Required(1));
        for body in [low, high] {
            let before = (i > 0).then(|| (body - 3, [0.5, 0.0]));
            rows.extend(pin(before, (body, [-0.5, 0.0]), forest));
            angles.push(angle((i > 0).then(|| body - 3), body));
        }
        rows.extend(pin(Some((low, [0.5, 0.0])), (rung, [0.0, -0.5]), forest));
        rows.extend(pin(Some((high, [0.5, 0.0])), (rung, [0.0, 0.5]), closing));
        angles.push(angle(Some(low), rung));
    }
    rows.extend(angles);
    rows
}

#[test] // truth: freedom of a ladder of parallelograms, one per loop, by hand; work by counting
fn a_ladder_takes_work_in_proportion_to_its_loops() {
    let work = |loops: usize| {
        let rows = ladder(loops);
        let found = independent_rows(3 * loops, 3, &rows, 1e-9, 0.4).unwrap();
        let required = rows.iter().filter(|r| matches!(r.claim, Claim::Required(_))).count();
        assert_eq!(found.taken.iter().filter(|&&i| i >= required).count(), loops);
        assert!(found.redundant.is_empty());
        found.operations as f64
    };
    let (small, large) = (work(100), work(3000));
    let exponent = (large / small).ln() / 30f64.ln();
    assert!(exponent < 1.02, "work grows with the power {exponent:.3} of the loops");
}

#[test] // truth: the choice by hand, of two rows for one column and three for two
fn preferred_rows_are_compared_by_what_is_left_of_them_times_their_weight() {
    let row = |entries: &[(usize, f64)], claim| OfferedRow { entries: entries.to_vec(), claim };
    let taken =
        |rows: &[OfferedRow], width| independent_rows(1, width, rows, 1e-9, 0.4).unwrap().taken;
    // Weight decides, unless too little is left, whatever the order.
    for (weight, left, expected) in [(3.0, 0.5, 0), (1.5, 0.5, 1), (1e6, 0.3, 1)] {
        let (one, other) =
            (row(&[(0, left)], Claim::Preferred(weight)), row(&[(0, 1.0)], Claim::Preferred(1.0)));
        assert_eq!(taken(&[one.clone(), other.clone()], 1), [expected], "{weight}, {left}");
        assert_eq!(taken(&[other, one], 1), [1 - expected], "{weight}, {left}");
    }
    // Of those in turn the first of which enough is left stands for all, against the others by weight.
    let turn = |left| row(&[(0, left)], Claim::InTurn(1.0));
    assert_eq!(taken(&[turn(0.3), turn(0.5), turn(1.0)], 1), [1]);
    let weighed = |weight| row(&[(0, 1.0)], Claim::Preferred(weight));
    assert_eq!(taken(&[weighed(0.4), turn(0.5)], 1), [1]);
    assert_eq!(taken(&[weighed(0.6), turn(0.5)], 1), [0]);
    assert_eq!(taken(&[row(&[(0, 0.01)], Claim::Preferred(101.0)), turn(1.0)], 1), [0]);
    // What is preferred and in turn is not worse off than what is in turn alone, and better off than its turn.
    // By itself it is compared with others by weight alone: sizes of different kinds say nothing of each other.
    let both = |weight, left| row(&[(0, left)], Claim::PreferredInTurn(weight));
    for (weight, left, expected) in [(1.1, 0.5, 0), (1.1, 0.3, 1)] {
        assert_eq!(taken(&[both(weight, left), turn(1.0)], 1), [expected], "{weight}, {left}");
    }
    for (weight, left, expected) in [(1.1, 0.5, 0), (3.0, 0.5, 1), (1e6, 0.3, 1)] {
        assert_eq!(taken(&[turn(1.0), both(weight, left)], 1), [expected], "{weight}, {left}");
    }
    // What is left beside the first: of the second nothing, of the third a half.
    let three = [
        row(&[(0, 1.0), (1, 1.0)], Claim::Preferred(5.0)),
        row(&[(0, 2.0), (1, 2.0)], Claim::Preferred(1.0)),
        row(&[(0, 1.0), (1, 0.0)], Claim::Preferred(1.0)),
    ];
    assert_eq!(taken(&three, 2), [0, 2]);
}
