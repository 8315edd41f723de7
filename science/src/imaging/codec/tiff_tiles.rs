//! Reads tiles that extend beyond the right edge of the picture, with LZW. The decoder reads the rows of such a tile in
//! part and skips the rest, which fails for some valid LZW data.

use std::io::{Read, Seek};

use ::tiff::{
    TiffResult,
    decoder::{ChunkType, Decoder, DecodingResult, Limits},
    tags::{CompressionMethod, Tag},
};

/// True for pictures that [`read`] is for.
pub(super) fn extend_beyond<R: Read + Seek>(decoder: &mut Decoder<R>) -> bool {
    let compression = decoder.find_tag_unsigned::<u16>(Tag::Compression).ok().flatten();
    let Ok((width, _)) = decoder.dimensions() else { return false };
    compression == Some(CompressionMethod::LZW.to_u16())
        && decoder.get_chunk_type() == ChunkType::Tile
        && width % decoder.chunk_dimensions().0.max(1) != 0
}

/// Reads the picture tile by tile, each in full width, and keeps what is inside the picture.
pub(super) fn read<R: Read + Seek>(decoder: &mut Decoder<R>, limits: &Limits) -> TiffResult<DecodingResult> {
    let (width, _) = decoder.dimensions()?;
    let (tile_width, tile_height) = decoder.chunk_dimensions();
    let mut out = DecodingResult::U8(Vec::new());
    let layout = decoder.image_buffer_layout()?;
    out.resize_to(&layout, limits)?;
    let pixel = layout.row_stride.map_or(0, usize::from) / width as usize;
    let tile_row = tile_width as usize * pixel;
    let across = width.div_ceil(tile_width);
    let mut tile = DecodingResult::U8(Vec::new());
    for index in 0..decoder.tile_count()? {
        decoder.read_chunk_to_buffer(&mut tile, index, tile_row)?;
        let (columns, rows) = decoder.chunk_data_dimensions(index);
        let (x, y) = (index % across * tile_width, index / across * tile_height);
        let (mut from, mut to) = (tile.as_buffer(0), out.as_buffer(0));
        let rows_of_tile = from.as_bytes_mut().chunks_exact(tile_row).take(rows as usize);
        for (row, of_tile) in rows_of_tile.enumerate() {
            let at = ((y as usize + row) * width as usize + x as usize) * pixel;
            let length = columns as usize * pixel;
            to.as_bytes_mut()[at..at + length].copy_from_slice(&of_tile[..length]);
        }
    }
    Ok(out)
}
