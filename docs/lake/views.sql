-- Views of a lake, for DuckDB. `lake` is the folder of the lake:
--   duckdb -cmd "SET VARIABLE lake = 'lake'" -cmd ".read docs/lake/views.sql" -f docs/lake/fault-rate.sql
SET TimeZone = 'UTC';
CREATE VIEW captures AS SELECT * FROM read_parquet(getvariable('lake') || '/captures/**/*.parquet');
-- A run that was killed may have left files of a capture that is not listed yet.
CREATE VIEW findings AS
    SELECT * FROM read_parquet(getvariable('lake') || '/findings/**/*.parquet')
    WHERE capture_hash IN (SELECT capture_hash FROM captures);
CREATE VIEW events AS
    SELECT * FROM read_parquet(getvariable('lake') || '/events/**/*.parquet')
    WHERE capture_hash IN (SELECT capture_hash FROM captures);
CREATE VIEW signals AS
    SELECT * FROM read_parquet(getvariable('lake') || '/signals/**/*.parquet')
    WHERE capture_hash IN (SELECT capture_hash FROM captures);
CREATE VIEW objects AS
    SELECT * FROM read_parquet(getvariable('lake') || '/objects/**/*.parquet')
    WHERE capture_hash IN (SELECT capture_hash FROM captures);
