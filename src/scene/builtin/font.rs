//! A small bitmap font, and pages of it as textures.

use crate::scene::texture::{Mips, blend};

/// Columns and rows of a glyph.
const GLYPH: (usize, usize) = (5, 7);

/// Seven rows of five bits, the leftmost the highest.
const GLYPHS: [(char, [u8; 7]); 38] = [
    ('A', [14, 17, 17, 31, 17, 17, 17]),
    ('B', [30, 17, 17, 30, 17, 17, 30]),
    ('C', [14, 17, 16, 16, 16, 17, 14]),
    ('D', [30, 17, 17, 17, 17, 17, 30]),
    ('E', [31, 16, 16, 30, 16, 16, 31]),
    ('F', [31, 16, 16, 30, 16, 16, 16]),
    ('G', [14, 17, 16, 23, 17, 17, 15]),
    ('H', [17, 17, 17, 31, 17, 17, 17]),
    ('I', [14, 4, 4, 4, 4, 4, 14]),
    ('J', [7, 2, 2, 2, 2, 18, 12]),
    ('K', [17, 18, 20, 24, 20, 18, 17]),
    ('L', [16, 16, 16, 16, 16, 16, 31]),
    ('M', [17, 27, 21, 21, 17, 17, 17]),
    ('N', [17, 25, 21, 19, 17, 17, 17]),
    ('O', [14, 17, 17, 17, 17, 17, 14]),
    ('P', [30, 17, 17, 30, 16, 16, 16]),
    ('Q', [14, 17, 17, 17, 21, 18, 13]),
    ('R', [30, 17, 17, 30, 20, 18, 17]),
    ('S', [15, 16, 16, 14, 1, 1, 30]),
    ('T', [31, 4, 4, 4, 4, 4, 4]),
    ('U', [17, 17, 17, 17, 17, 17, 14]),
    ('V', [17, 17, 17, 17, 17, 10, 4]),
    ('W', [17, 17, 17, 21, 21, 27, 17]),
    ('X', [17, 17, 10, 4, 10, 17, 17]),
    ('Y', [17, 17, 10, 4, 4, 4, 4]),
    ('Z', [31, 1, 2, 4, 8, 16, 31]),
    ('0', [14, 17, 19, 21, 25, 17, 14]),
    ('1', [4, 12, 4, 4, 4, 4, 14]),
    ('2', [14, 17, 1, 2, 4, 8, 31]),
    ('3', [30, 1, 1, 14, 1, 1, 30]),
    ('4', [2, 6, 10, 18, 31, 2, 2]),
    ('5', [31, 16, 30, 1, 1, 17, 14]),
    ('6', [14, 16, 16, 30, 17, 17, 14]),
    ('7', [31, 1, 2, 4, 8, 8, 8]),
    ('8', [14, 17, 17, 14, 17, 17, 14]),
    ('9', [14, 17, 17, 15, 1, 1, 14]),
    ('.', [0, 0, 0, 0, 0, 12, 12]),
    ('-', [0, 0, 0, 31, 0, 0, 0]),
];

/// Whether a glyph has ink in this cell; unknown ones have none.
fn has_ink(glyph: char, column: usize, row: usize) -> bool {
    let found = GLYPHS.iter().find(|(known, _)| *known == glyph);
    column < GLYPH.0 && row < GLYPH.1 && found.is_some_and(|(_, rows)| rows[row] >> (GLYPH.0 - 1 - column) & 1 == 1)
}

/// A page of lines that get smaller from top to bottom; `side` texels.
pub fn page(side: u32, text: &str, paper: [f32; 3], ink: [f32; 3]) -> Mips {
    // Cells of a glyph in texels: each line's own.
    let mut lines: Vec<(u32, u32, String)> = Vec::new();
    let mut words = text.split_whitespace().cycle().peekable();
    let (mut top, margin) = (side / 32, side / 24);
    for cell in [
        side / 128,
        side / 170,
        side / 256,
        side / 340,
        side / 512,
        side / 512,
        side / 1024,
    ]
    .into_iter()
    .flat_map(|cell| std::iter::repeat_n(cell.max(1), 3))
    .chain(std::iter::repeat(1))
    {
        let height = cell * GLYPH.1 as u32;
        if top + height + margin > side {
            break;
        }
        let room = ((side - 2 * margin) / (cell * 6)) as usize;
        let mut line = String::new();
        while line.len() + words.peek().map_or(0, |word| word.len() + 1) <= room {
            line += words.next().unwrap_or_default();
            line.push(' ');
        }
        lines.push((top, cell, line));
        top += height + height / 2 + 1;
    }
    Mips::paint(side, move |u, v| {
        let (x, y) = ((u * f64::from(side)) as u32, (v * f64::from(side)) as u32);
        let inked = lines.iter().any(|(top, cell, line)| {
            if y < *top || x < margin {
                return false;
            }
            let (column, row) = (((x - margin) / cell) as usize, ((y - top) / cell) as usize);
            line.as_bytes()
                .get(column / 6)
                .is_some_and(|&byte| has_ink(char::from(byte), column % 6, row))
        });
        blend(paper, ink, if inked { 1.0 } else { 0.0 })
    })
}
