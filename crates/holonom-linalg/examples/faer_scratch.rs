use faer::{
    Conj, MatMut, MatRef, Par,
    dyn_stack::{MemBuffer, MemStack},
    linalg::lu::partial_pivoting::{factor, solve},
};
use std::{hint::black_box, time::Instant};
fn time(name: &str, mut f: impl FnMut()) {
    let mut all = vec![];
    for _ in 0..1000 {
        let t = Instant::now();
        for _ in 0..10 {
            f();
        }
        all.push(t.elapsed().as_secs_f64() / 10.0 * 1e6);
    }
    all.sort_by(f64::total_cmp);
    println!("{name}: min {:.2} p20 {:.2} median {:.2} µs", all[0], all[200], all[500]);
}
fn main() {
    for (rows, k) in [(98, 3), (98, 6), (98, 18), (80, 18), (300, 80)] {
        let a = vec![1.0; rows * k];
        let b = vec![0.5; rows * k];
        let mut c = vec![0.0; k * k];
        time(&format!("gram {rows} {k}"), || {
            holonom_linalg::gram_add(rows, k, black_box(&a), black_box(&b), &mut c)
        });
    }
    for n in [6usize, 18, 80] {
        let mut a = vec![0.0; n * n];
        for i in 0..n {
            a[i * n + i] = 2.0;
        }
        let mut c = holonom_linalg::Cholesky::new(n);
        time(&format!("chol {n}"), || c.factor(black_box(&a)).unwrap());
    }
    {
        let mut blocks: Vec<_> = (0..14).map(|i| (7 * i, 7 * i, 7, 7)).collect();
        for e in 0..30 {
            let (i, j) = (e % 14, (e * 5 + 3) % 14);
            blocks.extend([(7 * i, 7 * j, 7, 7), (7 * j, 7 * i, 7, 7)]);
        }
        let (mut m, _) = holonom_linalg::BlockMatrix::new(98, 98, &blocks);
        m.values_mut().fill(0.3);
        let x = vec![1.0; 98 * 18];
        let mut y = vec![0.0; 98 * 18];
        println!("{}", m.values().len());
        time("blocks 18", || m.multiply_many_add(1.0, black_box(&x), 18, &mut y));
        time("blocksT 18", || m.multiply_transposed_many_add(1.0, black_box(&x), 18, &mut y));
        time("blocks 1", || m.multiply_add(1.0, black_box(&x[..98]), &mut y[..98]));
    }
    for n in [6usize, 12, 18, 80] {
        let mut state = 88172645463325252u64;
        let a: Vec<f64> = (0..n * n)
            .map(|_| {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
            })
            .collect();
        let mut lu = a.clone();
        let (mut p, mut q) = (vec![0usize; n], vec![0usize; n]);
        let mut mem = MemBuffer::new(
            factor::lu_in_place_scratch::<usize, f64>(n, n, Par::Seq, Default::default())
                .or(solve::solve_in_place_scratch::<usize, f64>(n, 18, Par::Seq))
                .or(solve::solve_transpose_in_place_scratch::<usize, f64>(n, 18, Par::Seq)),
        );
        time(&format!("{n} row-major factor"), || {
            lu.copy_from_slice(black_box(&a));
            factor::lu_in_place(
                MatMut::from_row_major_slice_mut(&mut lu, n, n),
                &mut p,
                &mut q,
                Par::Seq,
                MemStack::new(&mut mem),
                Default::default(),
            );
        });
        let mut x = vec![1.0; n * 18];
        time(&format!("{n} row-major solve 18 row-major"), || {
            x.fill(1.0);
            let l = MatRef::from_row_major_slice(&lu, n, n);
            let perm = faer::perm::PermRef::new_checked(&p, &q, n);
            solve::solve_in_place_with_conj(
                l,
                l,
                perm,
                Conj::No,
                MatMut::from_row_major_slice_mut(&mut x, n, 18),
                Par::Seq,
                MemStack::new(&mut mem),
            );
        });
        time(&format!("{n} col-major factor"), || {
            lu.copy_from_slice(black_box(&a));
            factor::lu_in_place(
                MatMut::from_column_major_slice_mut(&mut lu, n, n),
                &mut p,
                &mut q,
                Par::Seq,
                MemStack::new(&mut mem),
                Default::default(),
            );
        });
        time(&format!("{n} col-major T solve 18 row-major"), || {
            x.fill(1.0);
            let l = MatRef::from_column_major_slice(&lu, n, n);
            let perm = faer::perm::PermRef::new_checked(&p, &q, n);
            solve::solve_transpose_in_place_with_conj(
                l,
                l,
                perm,
                Conj::No,
                MatMut::from_row_major_slice_mut(&mut x, n, 18),
                Par::Seq,
                MemStack::new(&mut mem),
            );
        });
        time(&format!("{n} col-major solve 18 col-major"), || {
            x.fill(1.0);
            let l = MatRef::from_column_major_slice(&lu, n, n);
            let perm = faer::perm::PermRef::new_checked(&p, &q, n);
            solve::solve_in_place_with_conj(
                l,
                l,
                perm,
                Conj::No,
                MatMut::from_column_major_slice_mut(&mut x, n, 18),
                Par::Seq,
                MemStack::new(&mut mem),
            );
        });
        time(&format!("{n} col-major solve 18 row-major"), || {
            x.fill(1.0);
            let l = MatRef::from_column_major_slice(&lu, n, n);
            let perm = faer::perm::PermRef::new_checked(&p, &q, n);
            solve::solve_in_place_with_conj(
                l,
                l,
                perm,
                Conj::No,
                MatMut::from_row_major_slice_mut(&mut x, n, 18),
                Par::Seq,
                MemStack::new(&mut mem),
            );
        });
        let mut own = holonom_linalg::DenseLu::new(n);
        time(&format!("{n} own factor"), || {
            own.factor(black_box(&a)).unwrap();
        });
        time(&format!("{n} faer T solve 1"), || {
            x[..n].fill(1.0);
            let l = MatRef::from_column_major_slice(&lu, n, n);
            let perm = faer::perm::PermRef::new_checked(&p, &q, n);
            solve::solve_transpose_in_place_with_conj(
                l,
                l,
                perm,
                Conj::No,
                MatMut::from_row_major_slice_mut(&mut x[..n], n, 1),
                Par::Seq,
                MemStack::new(&mut mem),
            );
        });
        time(&format!("{n} own solve 1"), || {
            x[..n].fill(1.0);
            own.solve(black_box(&mut x[..n]));
        });
        time(&format!("{n} own solve 18"), || {
            x.fill(1.0);
            own.solve_many(black_box(&mut x), 18);
        });
    }
}
