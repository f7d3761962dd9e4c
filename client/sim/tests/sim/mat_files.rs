//! MATLAB files made here: both byte orders, compressed or not, labels, and everything that is refused.

use crate::made::Mat;
use foretrace_sim::data::{Quantity, Recording, load_recording};

const LITTLE: Mat = Mat { big_endian: false };

fn load(bytes: &[u8]) -> Result<Recording, String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.mat");
    std::fs::write(&file, bytes).unwrap();
    let folder = format!("{}/", folder.path().display());
    load_recording(&file).map_err(|error| error.to_string().replace(&folder, ""))
}

#[test]
fn velocities_become_positions_without_padding_and_labels_come_through_the_key() {
    for big_endian in [false, true] {
        for compress in [false, true] {
            let r = load(&Mat { big_endian }.train_file(compress)).unwrap();
            assert_eq!(
                (r.rate_hz, r.rate_assumed, r.units_per_m, r.quantity),
                (200.0, false, None, Quantity::Velocity)
            );
            let [a, b] = &r.segments[..] else { panic!("{:?}", r.segments) };
            assert_eq!((a.label.as_str(), b.label.as_str(), b.segment_index), ("qu\u{e9}", "p", 1));
            assert_eq!(a.writer, b.writer);
            // A pause inside the letter stays; padding goes.
            assert_eq!(a.components[0].points, [[0.0, 0.0], [1.0, 2.0], [1.0, 2.0], [4.0, 1.0]]);
            assert_eq!(b.components[0].points, [[0.0, 0.0], [0.25, 0.5], [0.0, 1.0]]);
            assert!(a.components[0].contact);
        }
    }
}

#[test]
fn the_layout_of_the_published_file_is_read_too() {
    let m = LITTLE;
    let consts = m.fields(
        "consts",
        &[
            ("dt", m.numbers("", [1, 1], &[0.005])),
            ("key", m.cells("", &[m.text("", "a")])),
            ("charlabels", m.numbers("", [1, 1], &[1.0])),
        ],
    );
    let mixout = m.cells("mixout", &[m.numbers("", [3, 1], &[1.0, 1.0, 1.0])]);
    assert_eq!(load(&m.file(&[mixout, consts])).unwrap().segments[0].label, "a");
}

#[test]
fn every_refusal_names_the_file_and_the_variable() {
    let m = LITTLE;
    let letter = |value: f64| m.numbers("", [3, 1], &[value, 1.0, 1.0]);
    let xtrain = m.cells("xtrain", &[letter(1.0)]);
    let key = m.cells("key", &[m.text("", "a")]);
    let deep = (0..12).fold(letter(1.0), |inside, _| m.cells("", &[inside]));
    let mut damaged = m.compressed(&xtrain);
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x55;
    let good = m.train_file(false);
    let mut hdf5 = good.clone();
    hdf5[7..10].copy_from_slice(b"7.3");
    let mut old = good.clone();
    old[125] = 4;
    let cases: [(Vec<u8>, &str); 16] = [
        (b"MATLAB".to_vec(), "a.mat: 6 bytes; a MATLAB file begins with 128"),
        (hdf5, "a.mat: MATLAB 7.3 (HDF5); save it with -v7 or -v6"),
        (old, "a.mat: not a MATLAB v5 file; save it with -v7 or -v6"),
        (good[..good.len() - 30].to_vec(), "a.mat: the data end inside variable 3"),
        (
            m.file(&[]),
            "a.mat: no cell array of 3 x T matrices (velocity x, velocity y, force) among the variables []",
        ),
        (
            m.file(&[m.cells("w", &[m.numbers("", [2, 1], &[1.0, 1.0])]), key.clone()]),
            "a.mat: no cell array of 3 x T matrices (velocity x, velocity y, force) among the variables [w, \
             key]",
        ),
        (
            m.file(&[xtrain.clone(), m.cells("b", &[letter(1.0)])]),
            "a.mat: several cell arrays of 3 x T matrices: xtrain, b; keep one per file",
        ),
        (
            m.file(&[m.cells("xtrain", &[letter(1.0), letter(f64::NAN)])]),
            "a.mat: xtrain{2}: velocity NaN in column 1 is outside [-1000000, 1000000]",
        ),
        (
            m.file(&[m.cells("x", &[m.numbers("", [3, 2], &[0.0; 6])])]),
            "a.mat: x{1}: nothing but zeros, which are padding",
        ),
        (m.file(&[xtrain.clone(), m.bytes("ytrain", &[1, 1])]), "a.mat: ytrain: 2 labels for 1 characters"),
        (
            m.file(&[xtrain.clone(), m.bytes("ytrain", &[2]), key.clone()]),
            "a.mat: ytrain(1) is 2; legal: 1 to 1, the entries of key",
        ),
        (
            m.file(&[xtrain.clone(), m.bytes("ytrain", &[1]), m.numbers("key", [1, 1], &[1.0])]),
            "a.mat: key: neither a text nor a cell array of texts",
        ),
        (
            m.file(&[m.numbers("q", [3, 9], &[1.0])]),
            "a.mat: variable 1: q: 1 numbers where its dimensions say 27",
        ),
        (
            m.file(&[m.element(9, &[0; 8])]),
            "a.mat: variable 1: an element of type 9 where an array must stand (type 14)",
        ),
        (m.file(&[m.cells("deep", &[deep])]), "a.mat: variable 1: deep: cell 1: cell 1: "),
        (m.file(&[damaged]), "a.mat: variable 1: the compressed data are damaged: "),
    ];
    for (bytes, wanted) in cases {
        let message = load(&bytes).unwrap_err();
        assert!(message.starts_with(wanted), "{message}\nwanted: {wanted}");
    }
}

#[test]
fn a_bomb_of_zeros_is_refused_before_it_is_inflated() {
    // 160 MiB from 700 kB.
    let bomb = LITTLE.compressed(&vec![0; 160 << 20]);
    assert!(bomb.len() < 1 << 20);
    let message = load(&LITTLE.file(&[bomb])).unwrap_err();
    assert_eq!(message, "a.mat: variable 1: the compressed data inflate to more than 134217728 bytes");
    // A cell array that claims more cells than bytes exist.
    let mut huge = LITTLE.file(&[LITTLE.cells("c", &[LITTLE.numbers("", [3, 1], &[1.0; 3])])]);
    huge[128 + 8 + 16 + 8..][..8].fill(0x7f);
    let claimed = 0x7f7f_7f7f_usize.pow(2);
    let wanted = format!("a.mat: variable 1: c: the data end inside cell 2 of {claimed}");
    assert_eq!(load(&huge).unwrap_err(), wanted);
}
