//! Finds JPEGs whose picture data were damaged although a decoder accepts them.
//!
//! A few wrong bytes, as a failing card or cable makes them, shift all blocks behind them or change their brightness,
//! and mostly still decode. But the codes of the last block, or of the last before a restart marker, then end
//! elsewhere: data are left over, or there are too few. This module follows the Huffman codes (ITU T.81, annex C and
//! F.2.2) of a baseline picture without making pixels, and compares where they end with where the markers are.

use super::{Head, PROGRESSIVE};

/// A Huffman table. Codes are the first of 16 bits: those of a length begin where the shorter ones end.
struct Table {
    /// For each length, the end of its codes, and the index of a symbol less its code.
    lengths: [(u32, i32); 16],
    symbols: Vec<u8>,
    /// What [`Table::search`] finds by the first 12 bits; a length of 0 where these are not all of the code.
    short: Vec<(u8, u8)>,
}

impl Table {
    fn new(counts: &[u8], symbols: &[u8]) -> Self {
        let (mut code, mut index, mut lengths) = (0, 0, [(0, 0); 16]);
        for (at, (length, &count)) in lengths.iter_mut().zip(counts).enumerate() {
            let first = index - code;
            code += i32::from(count);
            index += i32::from(count);
            *length = ((code as u32) << (15 - at), first);
            code <<= 1;
        }
        let mut table = Self { lengths, symbols: symbols.to_vec(), short: Vec::new() };
        let short = |first: u32| table.search(first << 4).filter(|(length, _)| *length <= 12);
        table.short = (0..4096).map(|first| short(first).unwrap_or_default()).collect();
        table
    }

    /// Length and symbol of the code that the 16 bits begin with.
    fn find(&self, bits: u32) -> Option<(u8, u8)> {
        let found = self.short[(bits >> 4) as usize];
        if found.0 > 0 { Some(found) } else { self.search(bits) }
    }

    fn search(&self, bits: u32) -> Option<(u8, u8)> {
        let at = self.lengths.iter().position(|(end, _)| bits < *end)?;
        let index = self.lengths[at].1 + (bits >> (15 - at)) as i32;
        Some((at as u8 + 1, *self.symbols.get(usize::try_from(index).ok()?)?))
    }
}

/// Of a table: how many codes each length has, and the symbols.
type Definition<'a> = (&'a [u8], &'a [u8]);

/// Of a component of a scan: blocks per MCU, DC table, AC table.
type Component = (usize, Table, Table);

/// True when the codes of the picture do not end where its data end. False for pictures that are not baseline in one
/// scan, about which this says nothing, and for a torn header.
pub(in crate::imaging) fn is_damaged(file: &[u8]) -> bool {
    let mut data = file;
    let Ok(head) = Head::read(&mut data) else { return false };
    let Some(components) = components(&head).filter(|found| found.len() == head.components.len()) else { return false };
    let most = |axis: usize| head.sampling.iter().map(|factors| usize::from(factors[axis])).max();
    // the blocks of a single component are not grouped
    let side = |axis: usize| if components.len() == 1 { 8 } else { 8 * most(axis).unwrap_or(1).max(1) };
    let mcus = usize::from(head.width).div_ceil(side(0)) * usize::from(head.height).div_ceil(side(1));
    head.process < PROGRESSIVE && follow(data, &components, usize::from(head.interval), mcus).is_none()
}

/// The components of the first scan.
fn components(head: &Head) -> Option<Vec<Component>> {
    let (mut dc, mut ac): ([Option<Definition<'_>>; 4], _) = ([None; 4], [None; 4]);
    for mut segment in head.tables.iter().map(Vec::as_slice) {
        while let Some((&class, rest)) = segment.split_first() {
            let (counts, rest) = rest.split_at_checked(16)?;
            let (symbols, rest) = rest.split_at_checked(counts.iter().map(|count| usize::from(*count)).sum())?;
            let tables = if class >> 4 == 0 { &mut dc } else { &mut ac };
            *tables.get_mut(usize::from(class & 15))? = Some((counts, symbols));
            segment = rest;
        }
    }
    let (&count, scan) = head.scan.split_first()?;
    let component = |of: &[u8]| {
        let [x, y] = *head.sampling.get(head.components.iter().position(|id| *id == of[0])?)?;
        let blocks = if count == 1 { 1 } else { usize::from(x) * usize::from(y) };
        let table = |of: &[Option<Definition<'_>>; 4], number: u8| {
            of.get(usize::from(number))?.map(|(counts, symbols)| Table::new(counts, symbols))
        };
        Some((blocks, table(&dc, of[1] >> 4)?, table(&ac, of[1] & 15)?))
    };
    scan.chunks_exact(2).take(usize::from(count)).map(component).collect()
}

/// Follows the codes of `mcus` MCUs; `None` unless they end where the data do, and those of each restart interval at
/// its marker.
fn follow(data: &[u8], components: &[Component], interval: usize, mcus: usize) -> Option<()> {
    let mut bits = Bits { data, at: 0, buffer: 0, count: 0 };
    for mcu in 1..=mcus {
        for (blocks, dc, ac) in components {
            (0..*blocks).try_for_each(|_| bits.block(dc, ac))?;
        }
        if mcu == mcus || (interval > 0 && mcu % interval == 0) {
            bits.next_interval()?;
        }
    }
    Some(())
}

/// The bits of entropy-coded data up to the next marker.
struct Bits<'a> {
    data: &'a [u8],
    at: usize,
    /// The next bits, at the high end.
    buffer: u64,
    count: u32,
}

impl Bits<'_> {
    /// Reads until there are more than 32 bits, or up to a marker.
    fn fill(&mut self) {
        if let Some(next) = self.data.get(self.at..).and_then(|rest| rest.first_chunk::<4>())
            && self.count <= 32
            && !next.contains(&0xFF)
        {
            self.at += 4;
            self.buffer |= u64::from(u32::from_be_bytes(*next)) << (32 - self.count);
            self.count += 32;
        }
        while self.count <= 32 {
            let byte = match self.data.get(self.at..) {
                Some([0xFF, 0, ..]) => 0xFF,
                Some(&[byte, ..]) if byte != 0xFF => byte,
                _ => return,
            };
            self.at += if byte == 0xFF { 2 } else { 1 };
            self.buffer |= u64::from(byte) << (56 - self.count);
            self.count += 8;
        }
    }

    /// Drops `count` bits; `None` when there are fewer.
    fn skip(&mut self, count: u32) -> Option<()> {
        self.count = self.count.checked_sub(count)?;
        self.buffer <<= count;
        Some(())
    }

    /// The next symbol.
    fn symbol(&mut self, table: &Table) -> Option<u8> {
        // a code and what follows it have at most 31 bits
        if self.count < 32 {
            self.fill();
        }
        let (length, symbol) = table.find((self.buffer >> 48) as u32)?;
        self.skip(u32::from(length))?;
        Some(symbol)
    }

    /// One block of 64 coefficients; `None` when its codes are none.
    fn block(&mut self, dc: &Table, ac: &Table) -> Option<()> {
        let size = self.symbol(dc)?;
        self.skip(u32::from(size & 15))?;
        let mut coefficient = 1;
        while coefficient < 64 {
            let symbol = self.symbol(ac)?;
            let (run, size) = (usize::from(symbol >> 4), u32::from(symbol & 15));
            if size == 0 && run < 15 {
                return Some(());
            }
            coefficient += run + 1;
            self.skip(size)?;
        }
        (coefficient == 64).then_some(())
    }

    /// Goes behind the next marker; `None` when a byte or more is left before it.
    fn next_interval(&mut self) -> Option<()> {
        self.fill();
        if self.count >= 8 {
            return None;
        }
        (self.buffer, self.count) = (0, 0);
        while self.data.get(self.at + 1) == Some(&0xFF) {
            self.at += 1;
        }
        self.at += 2;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{DHT, SOS},
        *,
    };

    /// Pictures of libjpeg.
    const BASELINE: &[u8] = include_bytes!("../testdata/baseline.jpg");
    const RESTART: &[u8] = include_bytes!("../testdata/restart.jpg");
    const PROGRESSIVE_ONE: &[u8] = include_bytes!("../testdata/progressive.jpg");

    fn scan_of(file: &[u8]) -> usize {
        file.windows(2).position(|pair| pair == [0xFF, SOS]).expect("a scan") + 14
    }

    #[test]
    fn whole_pictures_are_not_damaged() {
        for file in [BASELINE, RESTART, PROGRESSIVE_ONE, &BASELINE[..40], b""] {
            assert!(!is_damaged(file));
        }
    }

    #[test]
    fn a_block_more_or_less_than_the_picture_has_is_damage() {
        for file in [BASELINE, RESTART] {
            let mut surplus = file.to_vec();
            surplus.splice(file.len() - 2..file.len() - 2, [0x12, 0x34]);
            assert!(is_damaged(&surplus), "data behind the last block");
            let mut short = file.to_vec();
            short.drain(file.len() - 6..file.len() - 2);
            assert!(is_damaged(&short), "a last block that ends early");
        }
        let first = scan_of(RESTART);
        let marker = first + RESTART[first..].windows(2).position(|pair| pair == [0xFF, 0xD0]).expect("a marker");
        let mut surplus = RESTART.to_vec();
        surplus.splice(marker..marker, [0x12, 0x34]);
        assert!(is_damaged(&surplus), "data before a restart marker");
    }

    #[test]
    fn wrong_bytes_are_seen_where_they_move_what_follows() {
        let (first, last) = (scan_of(BASELINE), BASELINE.len() - 60);
        let places: Vec<usize> = (first..last).step_by(((last - first) / 40).max(1)).collect();
        let found = places.iter().filter(|&&at| {
            let mut damaged = BASELINE.to_vec();
            damaged[at..at + 4].copy_from_slice(&[0x5A, 0x11, 0xC3, 0x08]);
            is_damaged(&damaged)
        });
        let found = found.count();
        assert!(found * 5 > places.len(), "{found} of {}", places.len());
    }

    #[test]
    fn impossible_tables_say_nothing_and_end() {
        let at = BASELINE.windows(2).position(|pair| pair == [0xFF, DHT]).expect("tables");
        let count = BASELINE[at + 5..at + 21].iter().map(|count| usize::from(*count)).sum::<usize>();
        for length in 0..16 {
            let mut impossible = BASELINE.to_vec();
            impossible[at + 5..at + 21].fill(0);
            impossible[at + 5 + length] = count as u8;
            // whatever it says of such a file, which no decoder reads
            let _ = is_damaged(&impossible);
        }
        assert!(!is_damaged(&BASELINE[..at + 30]), "torn");
    }
}
