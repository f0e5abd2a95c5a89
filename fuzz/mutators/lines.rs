//! Changes of a text of lines, such as a DBC file: lines are repeated, removed and exchanged, words put where others were, numbers set
//! to what is at the edge of a range.

use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};

/// Numbers at the edges of what a field of such a file may hold.
const EDGES: [&str; 16] = [
    "0",
    "1",
    "-1",
    "7",
    "8",
    "63",
    "64",
    "65",
    "255",
    "511",
    "512",
    "2047",
    "2048",
    "4294967295",
    "1e308",
    "-1e-309",
];

/// Changes the text in `data[..size]`; how many bytes it has then.
pub fn mutate(data: &mut [u8], size: usize, max_size: usize, seed: u32) -> usize {
    let mut rng = SmallRng::seed_from_u64(seed.into());
    let text = std::str::from_utf8(&data[..size]).ok();
    let Some(text) = text.filter(|text| text.lines().count() > 1 && rng.random_ratio(3, 4)) else {
        return libfuzzer_sys::fuzzer_mutate(data, size, max_size);
    };
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let at = rng.random_range(0..lines.len());
    let other = rng.random_range(0..lines.len());
    match rng.random_range(0..6) {
        0 => drop(lines.remove(at)),
        1 => lines.swap(at, other),
        2 => lines.insert(other, lines[at].clone()),
        3 => {
            let words: Vec<String> = lines[other]
                .split_inclusive([' ', '|', '@', ',', ':'])
                .map(str::to_owned)
                .collect();
            let mut changed: Vec<&str> = lines[at].split_inclusive([' ', '|', '@', ',', ':']).collect();
            if !words.is_empty() && !changed.is_empty() {
                let place = rng.random_range(0..changed.len());
                changed[place] = &words[rng.random_range(0..words.len())];
                lines[at] = changed.concat();
            }
        }
        _ => {
            let digits: Vec<usize> = lines[at]
                .match_indices(|c: char| c.is_ascii_digit())
                .map(|(n, _)| n)
                .collect();
            if !digits.is_empty() {
                let from = digits[rng.random_range(0..digits.len())];
                let length = lines[at][from..].chars().take_while(char::is_ascii_digit).count();
                let edge = EDGES[rng.random_range(0..EDGES.len())];
                lines[at].replace_range(from..from + length, edge);
            }
        }
    }
    let changed = lines.join("\n");
    let size = changed.len().min(max_size);
    data[..size].copy_from_slice(&changed.as_bytes()[..size]);
    size
}
