//! Lists the mutations of Rust sources for `tests/mutants`: one JSON object per line and mutation.
//!
//! `pieces` are the new text: a string as it is, or a range of the source in bytes, `@` is the number of the mutation.
//! Constants, array lengths, types, attributes, tests and `const fn` stay as they are: a switch works at run time only.

use std::ops::Range;
use std::{env, fs};

use proc_macro2::{Span, TokenTree};
use quote::ToTokens;
use serde_json::{Value, json};
use syn::parse::Parser;
use syn::punctuated::Punctuated;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{
    Attribute, BinOp, Block, Expr, ExprMethodCall, Lit, Meta, Pat, RangeLimits, ReturnType, Signature, Stmt,
    Token, UnOp,
};

/// Operators and methods, each followed by one that replaces it.
const PAIRS: &str = "< <= < > <= < > >= > < >= > == != != == || && && || + - - + * / / * % / & | | & ^ & << >> >> << += -= -= += &= |= \
    |= &= min max max min any all all any first last last first is_some is_none is_none is_some saturating_sub saturating_add \
    saturating_add saturating_sub wrapping_sub wrapping_add wrapping_add wrapping_sub checked_sub checked_add checked_add checked_sub";

/// Types of results that a function can return at once, and the values.
const RESULTS: &str = "bool true bool false Option None Vec Default::default() String Default::default() Result Ok(Default::default()) \
    u8 0 u8 1 u16 0 u16 1 u32 0 u32 1 u64 0 u64 1 usize 0 usize 1 i64 0 i64 1 f64 0.0";

struct Sites {
    file: String,
    source: String,
}

fn range(span: Span) -> Range<usize> {
    span.byte_range()
}

fn part(range: Range<usize>) -> Value {
    json!([range.start, range.end])
}

fn is_test(attributes: &[Attribute]) -> bool {
    let is_cfg =
        |it: &Attribute| matches!(&it.meta, Meta::List(list) if list.tokens.to_string().starts_with("test"));
    attributes.iter().any(|it| it.path().is_ident("test") || it.path().is_ident("cfg") && is_cfg(it))
}

/// Numbers next to a literal, in decimal notation with its suffix.
fn next_numbers(literal: &Lit) -> Vec<String> {
    match literal {
        Lit::Int(number) => {
            let value = number.base10_parse::<u128>().unwrap_or_default();
            let near = [value.checked_add(1), value.checked_sub(1)];
            near.iter().flatten().map(|it| format!("{it}{}", number.suffix())).collect()
        }
        Lit::Float(number) => {
            let value = number.base10_parse::<f64>().unwrap_or_default();
            let near = if value > 0.0 { vec![value * 1.1, value * 0.9] } else { vec![0.01] };
            near.iter().map(|it| format!("{it:?}{}", number.suffix())).collect()
        }
        _ => Vec::new(),
    }
}

/// The values that follow `key` in a list of pairs.
fn values_of<'a>(pairs: &'a str, key: &str) -> Vec<&'a str> {
    let words: Vec<_> = pairs.split_whitespace().collect();
    words.chunks_exact(2).filter(|pair| pair[0] == key).map(|pair| pair[1]).collect()
}

/// Operands of a chain of `&&`.
fn operands_of(expression: &Expr) -> Vec<&Expr> {
    match expression {
        Expr::Binary(it) if matches!(it.op, BinOp::And(_)) => {
            [operands_of(&it.left), operands_of(&it.right)].concat()
        }
        other => vec![other],
    }
}

fn has_let(expression: &Expr) -> bool {
    operands_of(expression).iter().any(|it| matches!(it, Expr::Let(_)))
}

impl Sites {
    fn text(&self, range: &Range<usize>) -> String {
        let text = self.source.get(range.clone()).unwrap_or_default();
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// Prints a mutation of `whole`; without `code` and `change`, they follow from `pieces`.
    fn add(&self, whole: &Range<usize>, code: &str, change: &str, pieces: &[Value]) {
        let place = json!({"file": self.file, "start": whole.start, "end": whole.end});
        println!("{}", json!([place, code, change, pieces]));
    }

    /// `changed` in place of `whole`, as an expression.
    fn either(&self, whole: Range<usize>, changed: Vec<Value>) {
        let (open, rest) =
            (json!("(if crate::mutant::on(@) { "), [json!(" } else { "), part(whole.clone()), json!(" })")]);
        self.add(&whole, "", "", &[&[open][..], &changed, &rest].concat());
    }

    /// `before` and `after` around `whole`.
    fn around(&self, whole: &Range<usize>, change: &str, before: &str, after: &str) {
        self.add(whole, "", change, &[json!(before), part(whole.clone()), json!(after)]);
    }

    /// `other` in place of the part `at` of `whole`.
    fn replace(&self, whole: &Range<usize>, at: &Range<usize>, other: &str) {
        self.either(whole.clone(), vec![part(whole.start..at.start), json!(other), part(at.end..whole.end)]);
    }

    fn replace_number(&self, whole: &Range<usize>, literal: &Lit) {
        next_numbers(literal).iter().for_each(|it| self.replace(whole, &range(literal.span()), it));
    }

    fn binary(&self, it: &syn::ExprBinary) {
        let (whole, at) = (range(it.span()), range(it.op.span()));
        let is_chain = matches!(it.op, BinOp::And(_)) && (has_let(&it.left) || has_let(&it.right));
        values_of(PAIRS, &self.text(&at))
            .iter()
            .filter(|_| !is_chain)
            .for_each(|it| self.replace(&whole, &at, it));
    }

    fn condition(&self, condition: &Expr) {
        if !has_let(condition) {
            let whole = range(condition.span());
            let change = format!("!({})", self.text(&whole));
            return self.around(&whole, &change, "(crate::mutant::on(@) != (", "))");
        }
        for operand in operands_of(condition).into_iter().filter(|it| !matches!(it, Expr::Let(_))) {
            self.around(&range(operand.span()), "true", "(crate::mutant::on(@) || (", "))");
        }
    }

    fn matching(&self, it: &syn::ExprMatch, opening: &str, closing: &str) {
        let whole = range(it.span());
        let wildcard = it.arms.iter().position(|arm| matches!(arm.pat, Pat::Wild(_)) && arm.guard.is_none());
        for (place, arm) in it.arms.iter().enumerate() {
            let pattern = range(arm.pat.span());
            if let Some((_, guard)) = &arm.guard {
                if !has_let(guard) {
                    self.around(&range(guard.span()), "true", "(crate::mutant::on(@) || (", "))");
                    self.around(&range(guard.span()), "false", "(!crate::mutant::on(@) && (", "))");
                }
            } else if wildcard.is_some_and(|last| place < last) {
                let code = format!("{} =>", self.text(&pattern));
                let guard = json!(" if !crate::mutant::on(@) ");
                self.add(&(pattern.end..pattern.end), &code, "arm removed", &[guard]);
            }
            self.pattern(&whole, &arm.pat, opening, closing);
        }
    }

    /// Numbers of a pattern in `whole`, a match or an `if`, which is there twice.
    fn pattern(&self, whole: &Range<usize>, pattern: &Pat, opening: &str, closing: &str) {
        let (all, pattern) = (literals(pattern.to_token_stream()), range(pattern.span()));
        for literal in &all {
            let at = range(literal.span());
            for number in next_numbers(literal) {
                let around = [pattern.start..at.start, at.end..pattern.end].map(|it| self.text(&it));
                let (before, after) = (part(whole.start..at.start), part(at.end..whole.end));
                let changed = [json!(opening), before, json!(number), after, json!(" } else { ")];
                let pieces = [&changed[..], &[part(whole.clone()), json!(closing)]].concat();
                let change = format!("{}{number}{} =>", around[0], around[1]);
                self.add(whole, &format!("{} =>", self.text(&pattern)), &change, &pieces);
            }
        }
    }

    /// An `if`, written as a block of its own after `else`.
    fn branch(&mut self, it: &syn::ExprIf, opening: &str, closing: &str) {
        self.condition(&it.cond);
        for operand in operands_of(&it.cond) {
            if let Expr::Let(condition) = operand {
                self.pattern(&range(it.span()), &condition.pat, opening, closing);
            }
        }
        self.visit_expr(&it.cond);
        self.visit_block(&it.then_branch);
        match it.else_branch.as_ref().map(|(_, other)| &**other) {
            Some(Expr::If(it)) => self.branch(it, "{ if crate::mutant::on(@) { ", " } }"),
            Some(other) => self.visit_expr(other),
            None => {}
        }
    }

    fn method(&self, it: &ExprMethodCall) {
        let (whole, name, at) = (range(it.span()), it.method.to_string(), range(it.method.span()));
        values_of(PAIRS, &name).iter().for_each(|other| self.replace(&whole, &at, other));
        if matches!(name.as_str(), "abs" | "not" | "rev") && it.args.is_empty() {
            self.either(whole.clone(), vec![part(range(it.receiver.span()))]);
        }
        if let ("contains", Expr::Paren(inner)) = (name.as_str(), &*it.receiver)
            && let Expr::Range(limits) = &*inner.expr
        {
            let other = if matches!(limits.limits, RangeLimits::Closed(_)) { ".." } else { "..=" };
            self.replace(&whole, &range(limits.limits.span()), other);
        }
    }

    /// `matches!`, which is a condition with a pattern, and arguments of macros that format.
    fn call_of_macro(&mut self, it: &syn::Macro, whole: &Range<usize>) {
        let name = it.path.segments.last().map(|it| it.ident.to_string()).unwrap_or_default();
        if name == "matches" {
            self.around(whole, &format!("!{}", self.text(whole)), "(crate::mutant::on(@) != ", ")");
            let after = it.tokens.clone().into_iter();
            let after = after.skip_while(|it| !matches!(it, TokenTree::Punct(it) if it.as_char() == ','));
            let pattern = after.take_while(|it| !matches!(it, TokenTree::Ident(it) if it == "if"));
            literals(pattern).iter().for_each(|it| self.replace_number(whole, it));
        } else if matches!(name.as_str(), "format" | "write" | "writeln" | "vec") {
            let parser = Punctuated::<Expr, Token![,]>::parse_terminated;
            let Ok(arguments) = parser.parse2(it.tokens.clone()) else { return };
            arguments.iter().filter(|it| !matches!(it, Expr::Assign(_))).for_each(|it| self.visit_expr(it));
        }
    }

    /// A value at the start of a function in place of its result.
    fn early(&self, signature: &Signature, block: &Block) {
        let name = signature.ident.to_string();
        if block.stmts.is_empty() || matches!(name.as_str(), "fmt" | "default" | "drop" | "new") {
            return;
        }
        let values = match &signature.output {
            ReturnType::Default => vec![""],
            ReturnType::Type(_, of) => {
                let name = self.text(&range(of.span()));
                values_of(RESULTS, name.split(['<', ' ']).next().unwrap_or_default())
            }
        };
        let (start, body) = (range(block.brace_token.span.open()).end, self.text(&range(block.span())));
        for value in values.iter().filter(|it| body != format!("{{ {it} }}")) {
            let text = format!(" if crate::mutant::on(@) {{ return {value}; }} ");
            let change = format!("returns {}", if value.is_empty() { "at once" } else { value });
            self.add(&(start..start), &format!("fn {name}"), &change, &[json!(text)]);
        }
    }

    fn function(&mut self, attributes: &[Attribute], signature: &Signature, block: Option<&Block>) {
        if let (None, false, Some(block)) = (signature.constness, is_test(attributes), block) {
            self.early(signature, block);
            self.visit_block(block);
        }
    }
}

/// Literals of a pattern.
fn literals(tokens: impl IntoIterator<Item = TokenTree>) -> Vec<Lit> {
    let of = |token| match token {
        TokenTree::Literal(it) => vec![Lit::new(it)],
        TokenTree::Group(it) => literals(it.stream()),
        _ => Vec::new(),
    };
    tokens.into_iter().flat_map(of).collect()
}

/// Parts that stay as they are.
macro_rules! unchanged {
    ($($name:ident $kind:ident),*) => { $(fn $name(&mut self, _: &'ast syn::$kind) {})* };
}

impl<'ast> Visit<'ast> for Sites {
    unchanged! { visit_pat Pat, visit_type Type, visit_generic_argument GenericArgument, visit_attribute Attribute }
    unchanged! { visit_item_const ItemConst, visit_item_static ItemStatic, visit_item_enum ItemEnum }
    unchanged! { visit_impl_item_const ImplItemConst, visit_trait_item_const TraitItemConst }

    fn visit_item_mod(&mut self, it: &'ast syn::ItemMod) {
        if !is_test(&it.attrs) {
            visit::visit_item_mod(self, it);
        }
    }

    fn visit_item_fn(&mut self, it: &'ast syn::ItemFn) {
        self.function(&it.attrs, &it.sig, Some(&it.block));
    }

    fn visit_impl_item_fn(&mut self, it: &'ast syn::ImplItemFn) {
        self.function(&it.attrs, &it.sig, Some(&it.block));
    }

    fn visit_trait_item_fn(&mut self, it: &'ast syn::TraitItemFn) {
        self.function(&it.attrs, &it.sig, it.default.as_ref());
    }

    fn visit_stmt(&mut self, it: &'ast Stmt) {
        let is_removable = match it {
            Stmt::Expr(Expr::MethodCall(_) | Expr::Call(_) | Expr::Assign(_) | Expr::Return(_), Some(_)) => {
                true
            }
            Stmt::Expr(Expr::Try(_) | Expr::Break(_) | Expr::Continue(_), Some(_)) => true,
            Stmt::Macro(it) => it.semi_token.is_some(),
            _ => false,
        };
        if is_removable {
            self.around(&range(it.span()), "removed", "if !crate::mutant::on(@) { ", " }");
        }
        match it {
            Stmt::Expr(Expr::Match(it), None) => {
                self.matching(it, "if crate::mutant::on(@) { ", " }");
                visit::visit_expr_match(self, it);
            }
            Stmt::Expr(Expr::If(it), None) => self.branch(it, "if crate::mutant::on(@) { ", " }"),
            Stmt::Macro(it) => self.call_of_macro(&it.mac, &range(it.span())),
            _ => visit::visit_stmt(self, it),
        }
    }

    fn visit_expr(&mut self, it: &'ast Expr) {
        match it {
            Expr::Binary(it) => self.binary(it),
            Expr::Lit(it) => self.replace_number(&range(it.span()), &it.lit),
            Expr::Unary(it) if matches!(it.op, UnOp::Not(_) | UnOp::Neg(_)) => {
                self.either(range(it.span()), vec![part(range(it.expr.span()))]);
            }
            Expr::Path(it) => {
                let name = it.path.segments.last().map(|it| it.ident.to_string()).unwrap_or_default();
                if name.len() > 1
                    && name.chars().all(|it| it.is_ascii_uppercase() || it.is_ascii_digit() || it == '_')
                {
                    for change in [" + 1", " - 1"] {
                        self.either(range(it.span()), vec![part(range(it.span())), json!(change)]);
                    }
                }
            }
            Expr::If(it) => return self.branch(it, "(if crate::mutant::on(@) { ", " })"),
            Expr::While(it) => self.condition(&it.cond),
            Expr::Match(it) => self.matching(it, "(if crate::mutant::on(@) { ", " })"),
            Expr::MethodCall(it) if it.method == "reserve" => return,
            Expr::MethodCall(it) => self.method(it),
            Expr::Call(it) if self.text(&range(it.func.span())).ends_with("with_capacity") => return,
            Expr::Macro(it) => return self.call_of_macro(&it.mac, &range(it.span())),
            Expr::Repeat(it) => return self.visit_expr(&it.expr),
            Expr::Const(_) => return,
            _ => {}
        }
        visit::visit_expr(self, it);
    }
}

fn main() {
    for path in env::args().skip(1) {
        let Ok(source) = fs::read_to_string(&path) else { continue };
        let Ok(file) = syn::parse_file(&source) else { continue };
        Sites { file: path, source }.visit_file(&file);
    }
}
