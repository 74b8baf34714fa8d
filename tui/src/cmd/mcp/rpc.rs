//! JSON-RPC 2.0 in lines, as the Model Context Protocol uses it on standard input and output.

use std::io::{self, BufRead};

use serde_json::{Value, json};

/// Maximum length of a request in bytes.
pub(super) const LONGEST: usize = 1 << 20;

/// Error codes of JSON-RPC 2.0, section 5.1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RpcErrorCode {
    Parse,
    InvalidRequest,
    MethodNotFound,
    InvalidParams,
}

impl RpcErrorCode {
    const fn number(self) -> i32 {
        match self {
            Self::Parse => -32_700,
            Self::InvalidRequest => -32_600,
            Self::MethodNotFound => -32_601,
            Self::InvalidParams => -32_602,
        }
    }
}

/// A request, or a notification if it has no `id`.
#[derive(Debug, PartialEq)]
pub(super) struct RpcRequest {
    pub(super) id: Option<Value>,
    pub(super) method: String,
    pub(super) params: Value,
}

/// A line of input.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum RpcLine {
    /// A whole line is in the buffer.
    Whole,
    /// A line above [`LONGEST`]; it was skipped.
    TooLong,
    /// The input has ended.
    End,
}

/// Reads a line without its end into `line`.
pub(super) fn read_line(input: &mut impl BufRead, line: &mut Vec<u8>) -> io::Result<RpcLine> {
    line.clear();
    let (mut is_any, mut is_long) = (false, false);
    loop {
        let piece = match input.fill_buf() {
            Ok(piece) => piece,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) => return Err(error),
        };
        if piece.is_empty() {
            return Ok(if is_any { line_end(is_long) } else { RpcLine::End });
        }
        is_any = true;
        let end = piece.iter().position(|byte| *byte == b'\n');
        let part = piece.get(..end.unwrap_or(piece.len())).unwrap_or(piece);
        is_long |= line.len().saturating_add(part.len()) > LONGEST;
        if !is_long {
            line.extend_from_slice(part);
        }
        let taken = part.len().saturating_add(usize::from(end.is_some()));
        input.consume(taken);
        if end.is_some() {
            return Ok(line_end(is_long));
        }
    }
}

const fn line_end(is_long: bool) -> RpcLine {
    if is_long { RpcLine::TooLong } else { RpcLine::Whole }
}

impl RpcRequest {
    /// Parses a line; the error is the answer to it.
    pub(super) fn parse(line: &[u8]) -> Result<Self, String> {
        let request: Value = serde_json::from_slice(line).map_err(|error| {
            failure_answer(Value::Null, RpcErrorCode::Parse, &format!("not JSON: {error}"))
        })?;
        let id = request.get("id").cloned();
        let refuse = |text: &str| {
            let id = id.clone().filter(|id| id.is_string() || id.is_number()).unwrap_or(Value::Null);
            failure_answer(id, RpcErrorCode::InvalidRequest, text)
        };
        let Some(members) = request.as_object() else {
            return Err(refuse("expected one JSON object per line"));
        };
        if members.get("jsonrpc") != Some(&json!("2.0")) {
            return Err(refuse("expected \"jsonrpc\": \"2.0\""));
        }
        if id.as_ref().is_some_and(|id| !id.is_string() && !id.is_number()) {
            return Err(refuse("expected a string or a number as id"));
        }
        let Some(method) = members.get("method").and_then(Value::as_str) else {
            return Err(refuse("expected a method"));
        };
        let params = members.get("params").cloned().unwrap_or_else(|| json!({}));
        Ok(Self { id, method: method.to_owned(), params })
    }
}

/// The answer to a request.
pub(super) fn success_answer(id: &Value, result: &Value) -> String {
    json!({"jsonrpc": "2.0", "id": id, "result": result}).to_string()
}

/// The answer to a request that failed.
#[expect(clippy::needless_pass_by_value, reason = "most callers create the id")]
pub(super) fn failure_answer(id: Value, code: RpcErrorCode, text: &str) -> String {
    json!({"jsonrpc": "2.0", "id": id, "error": {"code": code.number(), "message": text}}).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[u8], capacity: usize) -> Vec<(RpcLine, Vec<u8>)> {
        let mut input = io::BufReader::with_capacity(capacity, text);
        let mut found = Vec::new();
        loop {
            let mut line = Vec::new();
            let kind = read_line(&mut input, &mut line).unwrap();
            if kind == RpcLine::End {
                return found;
            }
            found.push((kind, line));
        }
    }

    #[test]
    fn lines_are_read_in_any_pieces() {
        for capacity in [1, 2, 3, 100] {
            let found = lines(b"ab\n\ncdef\ng", capacity);
            let texts: Vec<_> = found.iter().map(|(_, line)| line.as_slice()).collect();
            assert_eq!(texts, [&b"ab"[..], b"", b"cdef", b"g"]);
        }
    }

    #[test]
    fn a_line_that_is_too_long_is_skipped() {
        let text = [vec![b'x'; LONGEST + 1], b"\nnext\n".to_vec()].concat();
        let found = lines(&text, 8_192);
        assert_eq!(found[0].0, RpcLine::TooLong);
        assert_eq!(found[1], (RpcLine::Whole, b"next".to_vec()));
        let most = [vec![b'x'; LONGEST], b"\n".to_vec()].concat();
        assert_eq!(lines(&most, 8_192)[0].0, RpcLine::Whole);
    }

    #[test]
    fn requests_and_what_is_none() {
        let request = RpcRequest::parse(br#"{"jsonrpc":"2.0","id":7,"method":"ping"}"#).unwrap();
        assert_eq!(request, RpcRequest { id: Some(json!(7)), method: "ping".into(), params: json!({}) });
        let error = |line: &[u8], code: i32| {
            let answer: Value = serde_json::from_str(&RpcRequest::parse(line).unwrap_err()).unwrap();
            assert_eq!(answer["error"]["code"], code, "{answer}");
            answer["id"].clone()
        };
        assert_eq!(error(b"{", -32_700), Value::Null);
        assert_eq!(error(b"[]", -32_600), Value::Null);
        assert_eq!(error(br#"{"id":1,"method":"ping"}"#, -32_600), json!(1));
        assert_eq!(error(br#"{"jsonrpc":"2.0","id":{},"method":"ping"}"#, -32_600), Value::Null);
        assert_eq!(error(br#"{"jsonrpc":"2.0","id":"a"}"#, -32_600), json!("a"));
    }
}
