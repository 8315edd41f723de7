//! Questions about a piece of Rust that `syn` has parsed: name and attributes of an item, the file of a module, the
//! paths that code names. They have no state; modules and arrows are in [`super::source`].

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use proc_macro2::{TokenStream, TokenTree};
use syn::Item;

/// The attributes of an item.
pub fn attributes_of(item: &Item) -> &[syn::Attribute] {
    match item {
        Item::Const(i) => &i.attrs,
        Item::Enum(i) => &i.attrs,
        Item::Fn(i) => &i.attrs,
        Item::Impl(i) => &i.attrs,
        Item::Macro(i) => &i.attrs,
        Item::Mod(i) => &i.attrs,
        Item::Static(i) => &i.attrs,
        Item::Struct(i) => &i.attrs,
        Item::Trait(i) => &i.attrs,
        Item::Type(i) => &i.attrs,
        Item::Union(i) => &i.attrs,
        Item::Use(i) => &i.attrs,
        _ => &[],
    }
}

/// The name that an item defines, if it is no module.
pub fn name_of(item: &Item) -> Option<String> {
    Some(match item {
        Item::Const(i) => i.ident.to_string(),
        Item::Enum(i) => i.ident.to_string(),
        Item::Fn(i) => i.sig.ident.to_string(),
        Item::Macro(i) => i.ident.as_ref()?.to_string(),
        Item::Static(i) => i.ident.to_string(),
        Item::Struct(i) => i.ident.to_string(),
        Item::Trait(i) => i.ident.to_string(),
        Item::Type(i) => i.ident.to_string(),
        Item::Union(i) => i.ident.to_string(),
        _ => return None,
    })
}

/// Whether an attribute says that the item is for tests or for the documentation alone.
pub fn is_left_out(attribute: &syn::Attribute) -> bool {
    let syn::Meta::List(list) = &attribute.meta else { return false };
    let words = list.tokens.to_string();
    list.path.is_ident("cfg") && (words.contains("test") || words == "doc") && !words.contains("not")
}

/// The file of `mod name;` and the folder of its children.
pub fn child_file(attributes: &[syn::Attribute], at: &Path, children: &Path, name: &str) -> (PathBuf, PathBuf) {
    for attribute in attributes {
        if let syn::Meta::NameValue(pair) = &attribute.meta
            && pair.path.is_ident("path")
            && let syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(text), .. }) = &pair.value
        {
            let file = at.parent().expect("a file is in a folder").join(text.value());
            let folder = file.parent().expect("a file is in a folder").to_owned();
            return (file, folder);
        }
    }
    let folder = children.join(name);
    let inside = folder.join("mod.rs");
    (if inside.exists() { inside } else { children.join(format!("{name}.rs")) }, folder)
}

/// Collects the paths `a::b::c` in a piece of code; what follows a dot is a field or a method.
pub fn paths_in(tokens: TokenStream, found: &mut BTreeSet<Vec<String>>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let is = |i: usize, c: char| matches!(tokens.get(i), Some(TokenTree::Punct(p)) if p.as_char() == c);
    let mut i = 0;
    while i < tokens.len() {
        match &tokens[i] {
            // doc comments are attributes of plain text, and hold no path
            TokenTree::Group(group) => paths_in(group.stream(), found),
            TokenTree::Ident(ident) if i == 0 || !(is(i - 1, '.') && !(i > 1 && is(i - 2, '.'))) => {
                let mut path = vec![ident.to_string()];
                while is(i + 1, ':') && is(i + 2, ':') {
                    let Some(TokenTree::Ident(next)) = tokens.get(i + 3) else { break };
                    path.push(next.to_string());
                    i += 3;
                }
                found.insert(path);
            }
            _ => {}
        }
        i += 1;
    }
}
