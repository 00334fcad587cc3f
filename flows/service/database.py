"""The server's database: made when PostgreSQL answers but does not have it yet."""

from flows.endings import Refused


async def create_if_missing(url: str) -> None:
    """`url` as SQLAlchemy writes it. Raises Refused with what is wrong, never with the password."""
    import asyncpg
    from sqlalchemy.engine import make_url

    wanted = make_url(url)
    if not wanted.drivername.startswith("postgresql"):
        return
    where = f"PostgreSQL at {wanted.host}:{wanted.port or 5432}"
    try:
        connection = await asyncpg.connect(
            host=wanted.host, port=wanted.port or 5432, user=wanted.username, password=wanted.password, database="postgres", timeout=10
        )
    except (OSError, asyncpg.PostgresError) as refused:
        raise Refused(f"{where} cannot be used: {type(refused).__name__}; check service.database") from None
    try:
        if await connection.fetchval("SELECT 1 FROM pg_database WHERE datname = $1", wanted.database) is None:
            await connection.execute(f'CREATE DATABASE "{wanted.database}"')
    except asyncpg.PostgresError as refused:
        raise Refused(f"{where} has no database {wanted.database!r} and does not let us make it: {type(refused).__name__}") from None
    finally:
        await connection.close()
